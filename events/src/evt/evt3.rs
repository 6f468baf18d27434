//! EVT 3.0: 16-bit little-endian words; a type in the high 4 bits, 12 bits of content. (Prophesee, "EVT 3.0 Format".)
//!
//! | type | name | content |
//! |---|---|---|
//! | 0 | `EVT_ADDR_Y` | row in 11 bits; the twelfth tells two cameras on one link apart and is ignored |
//! | 2 | `EVT_ADDR_X` | polarity, column in 11 bits: one event |
//! | 3 | `VECT_BASE_X` | polarity and first column of the vectors that follow |
//! | 4, 5 | `VECT_12`, `VECT_8` | one bit for each of the next 12 (8) columns; the base moves on by as many |
//! | 6, 8 | `EVT_TIME_LOW`, `EVT_TIME_HIGH` | low and high 12 bits of the time, microseconds; rolls over every 16.777 s |
//! | 10 | `EXT_TRIGGER` | channel in bits 8 to 11, edge in bit 0 |
//! | 14 | `OTHERS` | subtype, then 28 bits of payload in words 15, 15, 7 (`CONTINUED_12`, `CONTINUED_4`) |

use super::{
    super::{
        Anomalies, Decoder, Edge, SensorSize, Sink,
        clock::{Flags, LoopClock, Step},
        stage::{Stage, columns},
        state::{BitReader, BitWriter},
    },
    evt3_blocks::{BYTES, Masks, WORDS},
    evt3_vectors::{GROUP, Rows, group},
};

const NO_ROW: u16 = u16::MAX;
const NO_BASE: u16 = u16::MAX;
/// Bases stay below this, so that they never meet [`NO_BASE`].
const MAX_BASE: u16 = 0x7000;

/// A report of the sensor on itself, of which not all words came yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Monitor {
    subtype: u16,
    payload: u32,
    /// Words so far; 0 if there is no report.
    words: u8,
}

/// Subtype and payload of a report whose four words begin at word `at` of the block.
#[inline(always)]
fn report(block: &[u8; BYTES], at: u32) -> Option<(u16, u32)> {
    let words = u64::from_le_bytes(*block.get(2 * at as usize..)?.first_chunk()?);
    if words & 0xF000_F000_F000_F000 != 0x7000_F000_F000_E000 {
        return None;
    }
    let bits = |from: u32, mask: u64| (words >> from & mask) as u32;
    Some((bits(0, 0xFFF) as u16, bits(16, 0xFFF) | bits(32, 0xFFF) << 12 | bits(48, 0xF) << 24))
}

/// Decodes EVT 3.0.
#[derive(Clone, Debug)]
pub struct Evt3Decoder {
    width: u16,
    height: u16,
    clock: LoopClock<12, 12>,
    /// Low 12 bits of the time.
    low: u16,
    row: u16,
    base: u16,
    base_on: bool,
    monitor: Monitor,
    /// The first byte of a word whose second did not come yet.
    carry: Option<u8>,
    anomalies: Anomalies,
    stage: Stage,
}

impl Evt3Decoder {
    /// A decoder at the start of a stream. Without a size, all addresses are taken.
    #[must_use]
    pub fn new(size: Option<SensorSize>) -> Self {
        let size = size.unwrap_or(SensorSize::ALL);
        Self {
            width: size.width,
            height: size.height,
            clock: LoopClock::default(),
            low: 0,
            row: NO_ROW,
            base: NO_BASE,
            base_on: false,
            monitor: Monitor::default(),
            carry: None,
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// What the decoder remembers at this point, for [`Evt3Decoder::from_state`]. Counts of anomalies and hints of the
    /// host's clock are not part of it.
    #[must_use]
    pub fn state(&self) -> [u8; 16] {
        let (high, flags) = self.clock.save();
        let mut bits = BitWriter::default();
        bits.put(high, 36);
        bits.put(self.low, 12);
        flags.put(&mut bits);
        bits.put(if self.row == NO_ROW { 0x800 } else { self.row }, 12);
        bits.put(self.base & 0x7FFF, 15);
        bits.put(self.base_on, 1);
        bits.put(self.monitor.subtype, 12);
        bits.put(self.monitor.payload, 24);
        bits.put(self.monitor.words, 2);
        bits.carry(self.carry.as_slice(), 1);
        bits.bytes()
    }

    /// A decoder that goes on where another one gave its `state`.
    #[must_use]
    pub fn from_state(state: [u8; 16], size: Option<SensorSize>) -> Self {
        let mut bits = BitReader::new(state);
        let mut decoder = Self::new(size);
        let high = bits.take(36);
        decoder.low = bits.take(12) as u16;
        decoder.clock = LoopClock::restore(high, Flags::take(&mut bits));
        let row = bits.take(12) as u16;
        decoder.row = if row & 0x800 == 0 { row } else { NO_ROW };
        let base = bits.take(15) as u16;
        decoder.base = if base == 0x7FFF { NO_BASE } else { base.min(MAX_BASE) };
        decoder.base_on = bits.take(1) == 1;
        decoder.monitor.subtype = bits.take(12) as u16;
        decoder.monitor.payload = bits.take(24) as u32;
        decoder.monitor.words = bits.take(2) as u8;
        decoder.carry = bits.take_carry(1).first().copied();
        decoder
    }

    #[inline(always)]
    fn time_us(&self) -> u64 {
        self.clock.time_us() | u64::from(self.low)
    }

    /// Decodes up to 64 words, and at least one; says how many bytes they were.
    #[inline]
    fn block(&mut self, block: &[u8; BYTES], sink: &mut impl Sink) -> usize {
        if !self.clock.settled() || self.monitor.words > 0 {
            self.words(&block[..2], sink);
            return 2;
        }
        let masks = Masks::of(block, 0x8000 | self.clock.word() as u16);
        let words = block.as_chunks::<2>().0;
        let word = |at: u32| u16::from_le_bytes(words[at as usize % WORDS]);
        let last = |mask: u64, or: u16| if mask == 0 { or } else { word(63 - mask.leading_zeros()) & 0xFFF };
        // Row and low time words that are not in `self` yet.
        let (mut rows, mut lows) = (masks.row, masks.low);
        let mut todo = masks.event | masks.other;
        while todo != 0 {
            self.stage.room(WORDS, sink);
            let (width, height, high) = (self.width, self.height, self.clock.time_us());
            let (row, low) = (self.row, self.low);
            let Some((times, xs, ys, ons)) = self.stage.take::<WORDS>() else { break };
            let mut count = 0;
            let mut skipped = 0;
            // Events and reports on the sensor, up to a word that changes more.
            while todo != 0 {
                let at = todo.trailing_zeros();
                // Without shifts by a variable, which the oldest x86-64 processors are slow at.
                let bit = todo & todo.wrapping_neg();
                let below = bit - 1;
                if masks.event & bit != 0 {
                    todo ^= bit;
                    let y = last(rows & below, row);
                    let word = word(at);
                    let (x, y) = (word & 0x7FF, if y == NO_ROW { y } else { y & 0x7FF });
                    times[count % WORDS] = high | u64::from(last(lows & below, low));
                    xs[count % WORDS] = x;
                    ys[count % WORDS] = y;
                    ons[count % WORDS] = word & 0x800 != 0;
                    if x < width && y < height {
                        count += 1;
                    } else if y == NO_ROW {
                        self.anomalies.no_row += 1;
                    } else {
                        skipped += 1;
                    }
                    continue;
                }
                let Some((subtype, payload)) = report(block, at) else { break };
                todo &= u64::MAX << (at + 3) << 1;
                sink.monitor(high | u64::from(last(lows & below, low)), subtype, payload.into());
            }
            self.stage.give_back(WORDS - count);
            self.anomalies.outside += skipped;
            if todo == 0 {
                break;
            }
            let at = todo.trailing_zeros();
            let below = (1 << at) - 1;
            self.settle(last(rows & below, NO_ROW), last(lows & below, NO_ROW));
            rows &= !below;
            lows &= !below;
            // All words of other types that follow each other.
            let run = (masks.other >> at).trailing_ones();
            let mut done = at;
            for index in at..at + run {
                if index < done {
                    continue;
                }
                let (word, rest) = (word(index), &block[2 * index as usize..]);
                if word >> 12 == 3 {
                    let (first, more) = (group(rest), rest.get(GROUP..).and_then(group));
                    // Where more vectors follow, or may do so in the next block, all are decoded at once.
                    if index > 0 && (rest.len() < GROUP || first.is_some() && more.is_some()) {
                        return 2 * index as usize;
                    }
                    if let Some(group) = first
                        && self.clock.dated()
                    {
                        self.end_monitor(sink);
                        if self.rows(|rows, stage| rows.group(group, stage, sink)) {
                            done = index + 4;
                            continue;
                        }
                    }
                }
                self.word(word, sink);
                if word >> 12 == 8 {
                    // Which time words say nothing new is different now.
                    return 2 * index as usize + 2;
                }
            }
            let end = at + run;
            // A report that ended the run without its payload is complete: what follows is no continuation.
            if end < WORDS as u32 {
                self.end_monitor(sink);
            }
            todo &= if end >= 64 { 0 } else { u64::MAX << end };
        }
        self.settle(last(rows, NO_ROW), last(lows, NO_ROW));
        BYTES
    }

    /// Takes over a row and a low time word, where they are there.
    #[inline(always)]
    fn settle(&mut self, row: u16, low: u16) {
        if row != NO_ROW {
            self.row = row & 0x7FF;
        }
        if low != NO_ROW {
            self.low = low;
        }
    }

    /// Decodes whole words one by one.
    fn words(&mut self, bytes: &[u8], sink: &mut impl Sink) {
        for &word in bytes.as_chunks::<2>().0 {
            self.word(u16::from_le_bytes(word), sink);
        }
    }

    /// Decodes one word.
    fn word(&mut self, word: u16, sink: &mut impl Sink) {
        let (kind, content) = (word >> 12, word & 0xFFF);
        if self.monitor.words > 0 && !matches!(kind, 7 | 15) {
            self.end_monitor(sink);
        }
        match kind {
            0 => self.row = content & 0x7FF,
            2 => self.vector(content & 0x7FF, 1, content & 0x800 != 0, sink),
            3 => {
                self.base = content & 0x7FF;
                self.base_on = content & 0x800 != 0;
            }
            4 => self.columns(content, 12, sink),
            5 => self.columns(content & 0xFF, 8, sink),
            6 => self.low = content,
            7 => self.continued(content & 0xF, true, sink),
            8 => {
                let before = self.clock.time_us();
                let step = self.clock.step(content.into(), &mut self.anomalies);
                if self.clock.time_us() != before {
                    self.low = 0;
                }
                if step == Step::Discontinuity {
                    self.stage.flush(sink);
                    sink.discontinuity(self.time_us());
                }
            }
            10 => {
                if self.clock.dated() {
                    self.stage.flush(sink);
                    let channel = (content >> 8) as u8;
                    sink.edge(Edge { t_us: self.time_us(), channel, rising: content & 1 == 1 });
                } else {
                    self.anomalies.undated += 1;
                }
            }
            14 => self.monitor = Monitor { subtype: content, payload: 0, words: 1 },
            15 => self.continued(content, false, sink),
            _ => self.anomalies.unknown += 1,
        }
    }

    /// Has rows of vectors decoded that follow what was decoded so far.
    #[inline(always)]
    fn rows<R>(&mut self, decode: impl FnOnce(&mut Rows, &mut Stage) -> R) -> R {
        let Self { width, height, row, base, base_on: on, .. } = *self;
        let mut rows = Rows { width, height, t_us: self.time_us(), row, base, on };
        let decoded = decode(&mut rows, &mut self.stage);
        (self.row, self.base, self.base_on) = (rows.row, rows.base, rows.on);
        decoded
    }

    /// Decodes a vector of events: bit i of `mask` stands for column `base + i`.
    #[inline(always)]
    fn columns(&mut self, mask: u16, columns: u16, sink: &mut impl Sink) {
        if self.base == NO_BASE {
            self.anomalies.no_base += u64::from(mask != 0);
            return;
        }
        let base = self.base;
        self.vector(base, mask, self.base_on, sink);
        self.base = (base + columns).min(MAX_BASE);
    }

    #[inline(always)]
    fn vector(&mut self, base: u16, mask: u16, on: bool, sink: &mut impl Sink) {
        let y = self.row;
        let inside = self.width.saturating_sub(base).min(16);
        let visible = mask & ((1_u32 << inside) - 1) as u16;
        if y >= self.height || visible != mask || !self.clock.dated() {
            let count = |mask: u16| u64::from(mask.count_ones());
            if !self.clock.dated() {
                self.anomalies.undated += count(mask);
                return;
            }
            if y == NO_ROW {
                self.anomalies.no_row += count(mask);
                return;
            }
            if y >= self.height {
                self.anomalies.outside += count(mask);
                return;
            }
            self.anomalies.outside += count(mask & !visible);
        }
        let t = self.time_us();
        self.stage.room(16, sink);
        for (first, byte) in [(base, visible & 0xFF), (base + 8, visible >> 8)] {
            if byte != 0
                && let Some((times, xs, ys, ons)) = self.stage.take::<8>()
            {
                *times = [t; 8];
                *xs = columns(first, byte as u8);
                *ys = [y; 8];
                *ons = [on; 8];
                self.stage.give_back(8 - byte.count_ones() as usize);
            }
        }
    }

    /// Takes a word of payload; the third has 4 bits.
    fn continued(&mut self, content: u16, third: bool, sink: &mut impl Sink) {
        let words = self.monitor.words;
        if words == 0 || third != (words == 3) {
            self.anomalies.incomplete += 1;
            self.monitor.words = 0;
            return;
        }
        self.monitor.payload |= u32::from(content) << (12 * (words - 1));
        self.monitor.words += 1;
        if third {
            self.end_monitor(sink);
        }
    }

    /// Reports what is complete: all of the payload came, or none.
    fn end_monitor(&mut self, sink: &mut impl Sink) {
        let Monitor { subtype, payload, words } = std::mem::take(&mut self.monitor);
        match words {
            0 => {}
            1 | 4 if self.clock.dated() => sink.monitor(self.time_us(), subtype, payload.into()),
            1 | 4 => self.anomalies.undated += 1,
            _ => self.anomalies.incomplete += 1,
        }
    }
}

impl Decoder for Evt3Decoder {
    fn decode(&mut self, mut bytes: &[u8], sink: &mut impl Sink) {
        if let Some(first) = self.carry
            && let [second, rest @ ..] = bytes
        {
            self.carry = None;
            self.word(u16::from_le_bytes([first, *second]), sink);
            bytes = rest;
        }
        loop {
            if self.clock.settled() && self.monitor.words == 0 {
                bytes = &bytes[self.rows(|rows, stage| rows.decode(bytes, stage, sink))..];
            }
            let Some(block) = bytes.first_chunk() else { break };
            bytes = &bytes[self.block(block, sink)..];
        }
        self.words(bytes, sink);
        if !bytes.len().is_multiple_of(2) {
            self.carry = bytes.last().copied();
        }
        self.stage.flush(sink);
    }

    fn finish(&mut self, sink: &mut impl Sink) {
        self.anomalies.truncated_bytes += u64::from(self.carry.take().is_some());
        self.end_monitor(sink);
        self.stage.flush(sink);
    }

    fn restart(&mut self) {
        self.anomalies.truncated_bytes += u64::from(self.carry.take().is_some());
        self.anomalies.incomplete += u64::from(self.monitor.words > 0);
        self.monitor = Monitor::default();
        self.row = NO_ROW;
        self.base = NO_BASE;
        self.clock.restart();
    }

    fn hint_host_us(&mut self, host_us: u64) {
        self.clock.hint(host_us);
    }

    fn anomalies(&self) -> Anomalies {
        self.anomalies
    }
}
