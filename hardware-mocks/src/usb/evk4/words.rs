//! The words in which the sensor sends what it saw: EVT3, and EVT2.1 with the halves of each word swapped.

use erfgs_events::CdEvent;

/// What the sensor puts into its stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Item {
    Event(CdEvent),
    Edge {
        t_us: u64,
        rising: bool,
    },
    /// A count of the sensor's own: subtype and 28-bit value.
    Monitor {
        t_us: u64,
        subtype: u16,
        value: u32,
    },
}

impl Item {
    pub(super) fn t_us(&self) -> u64 {
        match *self {
            Self::Event(event) => event.t_us,
            Self::Edge { t_us, .. } | Self::Monitor { t_us, .. } => t_us,
        }
    }
}

/// Output formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Evt3,
    Evt21Legacy,
}

/// Encodes items in order of time. What it has already said (time, row) it does not repeat.
#[derive(Clone, Debug)]
pub(super) struct Encoder {
    format: Format,
    /// Time whose upper bits have been sent, and the whole time that has been sent last.
    high: Option<u64>,
    low: Option<u64>,
    row: Option<u16>,
}

impl Encoder {
    pub(super) fn new(format: Format) -> Self {
        Self { format, high: None, low: None, row: None }
    }

    pub(super) fn format(&self) -> Format {
        self.format
    }

    /// Forgets what has been sent, so that a decoder that starts here understands everything.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.format);
    }

    /// Appends the words of `items`, and the time `until_us` up to which there is nothing else.
    pub(super) fn encode(&mut self, items: &[Item], until_us: u64, out: &mut Vec<u8>) {
        let mut at = 0;
        while at < items.len() {
            at += match self.format {
                Format::Evt3 => self.evt3(&items[at..], out),
                Format::Evt21Legacy => self.evt21(&items[at..], out),
            };
        }
        match self.format {
            Format::Evt3 => self.evt3_high(until_us, out),
            Format::Evt21Legacy => self.evt21_high(until_us, out),
        }
    }

    /// EVT_TIME_HIGH: bits 12 to 23 of the time.
    fn evt3_high(&mut self, t_us: u64, out: &mut Vec<u8>) {
        let high = t_us >> 12;
        if self.high != Some(high) {
            out.extend((0x8000 | (high & 0xfff) as u16).to_le_bytes());
            self.high = Some(high);
            self.low = None;
        }
    }

    fn evt3(&mut self, items: &[Item], out: &mut Vec<u8>) -> usize {
        let mut word = |word: u16| out.extend(word.to_le_bytes());
        let t_us = items[0].t_us();
        let high = t_us >> 12;
        if self.high != Some(high) {
            word(0x8000 | (high & 0xfff) as u16);
            self.high = Some(high);
            self.low = None;
        }
        if self.low != Some(t_us) {
            word(0x6000 | (t_us & 0xfff) as u16);
            self.low = Some(t_us);
        }
        match items[0] {
            Item::Edge { rising, .. } => {
                word(0xa000 | u16::from(rising));
                1
            }
            Item::Monitor { subtype, value, .. } => {
                word(0xe000 | subtype & 0xfff);
                word(0xf000 | (value & 0xfff) as u16);
                word(0xf000 | (value >> 12 & 0xfff) as u16);
                word(0x7000 | (value >> 24 & 0xf) as u16);
                1
            }
            Item::Event(event) => {
                if self.row != Some(event.y) {
                    word(event.y & 0x7ff);
                    self.row = Some(event.y);
                }
                let (mask, count) = run(items, event, event.x);
                let place = event.x & 0x7ff | u16::from(event.on) << 11;
                if count < 3 {
                    word(0x2000 | place);
                    return 1;
                }
                // A base, then 12 + 12 + 8 pixels; words without a pixel at the end are left out.
                word(0x3000 | place);
                word(0x4000 | (mask & 0xfff) as u16);
                if mask >> 12 != 0 {
                    word(0x4000 | (mask >> 12 & 0xfff) as u16);
                }
                if mask >> 24 != 0 {
                    word(0x5000 | (mask >> 24) as u16);
                }
                count
            }
        }
    }

    fn evt21_high(&mut self, t_us: u64, out: &mut Vec<u8>) {
        let high = t_us >> 6;
        // An idle sensor says the time less often than the 64 us that the words resolve.
        if self.high.is_none_or(|sent| high >> 6 != sent >> 6) {
            legacy(8 << 60 | (high & 0xfff_ffff) << 32, out);
            self.high = Some(high);
        }
    }

    fn evt21(&mut self, items: &[Item], out: &mut Vec<u8>) -> usize {
        let t_us = items[0].t_us();
        let high = t_us >> 6;
        if self.high != Some(high) {
            legacy(8 << 60 | (high & 0xfff_ffff) << 32, out);
            self.high = Some(high);
        }
        let low = (t_us & 63) << 54;
        match items[0] {
            Item::Edge { rising, .. } => {
                legacy(0xa << 60 | low | u64::from(rising) << 32, out);
                1
            }
            Item::Monitor { subtype, value, .. } => {
                legacy(0xe << 60 | low | u64::from(subtype) << 32 | u64::from(value), out);
                1
            }
            Item::Event(event) => {
                let base = event.x & !31;
                let (mask, count) = run(items, event, base);
                let place = u64::from(base) << 43 | u64::from(event.y) << 32;
                legacy(u64::from(event.on) << 60 | low | place | u64::from(mask), out);
                count
            }
        }
    }
}

/// A 64-bit word with its upper half first.
fn legacy(word: u64, out: &mut Vec<u8>) {
    out.extend(((word >> 32) as u32).to_le_bytes());
    out.extend((word as u32).to_le_bytes());
}

/// How many of the first items fit into one mask of 32 pixels from column `base`: of one time, row and polarity, from
/// left to right, so that a decoder gives them back in this order.
fn run(items: &[Item], first: CdEvent, base: u16) -> (u32, usize) {
    let (mut mask, mut count, mut last) = (0_u32, 0, None);
    for item in items {
        let Item::Event(event) = *item else { break };
        let same = (event.t_us, event.y, event.on) == (first.t_us, first.y, first.on);
        if !same || event.x < base || event.x - base > 31 || last.is_some_and(|last| event.x <= last) {
            break;
        }
        mask |= 1 << (event.x - base);
        last = Some(event.x);
        count += 1;
    }
    (mask, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(t_us: u64, x: u16, y: u16, on: bool) -> Item {
        Item::Event(CdEvent { t_us, x, y, on })
    }

    fn words(bytes: &[u8]) -> Vec<u16> {
        bytes.chunks(2).map(|word| u16::from_le_bytes([word[0], word[1]])).collect()
    }

    #[test]
    fn evt3_says_time_row_and_place_and_nothing_twice() {
        let mut out = Vec::new();
        let items = [event(0x1234, 5, 7, true), event(0x1234, 9, 7, false), Item::Edge { t_us: 0x2001, rising: true }];
        Encoder::new(Format::Evt3).encode(&items, 0x2002, &mut out);
        assert_eq!(words(&out), [0x8001, 0x6234, 0x0007, 0x2805, 0x2009, 0x8002, 0x6001, 0xa001]);
    }

    #[test]
    fn evt3_packs_a_row_of_events_into_vectors() {
        let mut out = Vec::new();
        let items: Vec<Item> = (0..32).map(|x| event(1, 64 + x, 2, false)).collect();
        Encoder::new(Format::Evt3).encode(&items, 1, &mut out);
        assert_eq!(words(&out), [0x8000, 0x6001, 0x0002, 0x3040, 0x4fff, 0x4fff, 0x50ff]);
    }

    #[test]
    fn evt3_tells_its_counts_in_28_bits() {
        let mut out = Vec::new();
        Encoder::new(Format::Evt3).encode(&[Item::Monitor { t_us: 0, subtype: 0x14, value: 0xabc_def1 }], 0, &mut out);
        assert_eq!(words(&out), [0x8000, 0x6000, 0xe014, 0xfef1, 0xfbcd, 0x700a]);
    }

    #[test]
    fn evt21_words_come_upper_half_first() {
        let mut out = Vec::new();
        Encoder::new(Format::Evt21Legacy).encode(
            &[event(0x1003f, 33, 3, true), event(0x1003f, 35, 3, true)],
            0x1003f,
            &mut out,
        );
        let halves: Vec<u32> =
            out.chunks(4).map(|half| u32::from_le_bytes([half[0], half[1], half[2], half[3]])).collect();
        assert_eq!(halves, [0x8000_0400, 0, 1 << 28 | 0x3f << 22 | 32 << 11 | 3, 0b1010]);
    }

    #[test]
    fn an_idle_sensor_still_tells_the_time() {
        let mut encoder = Encoder::new(Format::Evt3);
        let mut out = Vec::new();
        encoder.encode(&[], 10, &mut out);
        encoder.encode(&[], 4095, &mut out);
        encoder.encode(&[], 4096, &mut out);
        assert_eq!(words(&out), [0x8000, 0x8001]);
    }
}
