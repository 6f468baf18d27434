//! EVT 2.0: 32-bit little-endian words; a type in the high 4 bits. (Prophesee, "EVT 2.0 Format".)
//!
//! | type | name | content |
//! |---|---|---|
//! | 0, 1 | `CD_OFF`, `CD_ON` | low 6 bits of the time in bits 22 to 27, column in 11 to 21, row in 0 to 10: one event |
//! | 8 | `EVT_TIME_HIGH` | the time without its low 6 bits; rolls over every 4 h 46 min |
//! | 10 | `EXT_TRIGGER` | low 6 bits of the time, channel in bits 8 to 12, edge in bit 0 |
//! | 14 | `OTHERS` | low 6 bits of the time, subtype in 16 bits, then perhaps a payload of 28 bits in a word 15 |
//! | 15 | `CONTINUED` | 28 bits |

use super::super::{
    Anomalies, CdEvent, Decoder, Edge, SensorSize, Sink,
    carry::Carry,
    clock::{Flags, LoopClock, Step},
    stage::Stage,
    state::{BitReader, BitWriter},
};

/// Words decoded at once where all of them are events.
const RUN: usize = 16;

/// Decodes EVT 2.0.
#[derive(Clone, Debug)]
pub struct Evt2Decoder {
    width: u16,
    height: u16,
    clock: LoopClock<28, 6>,
    /// Low bits of the time and subtype of a report whose payload may follow.
    monitor: Option<(u8, u16)>,
    carry: Carry<4>,
    anomalies: Anomalies,
    stage: Stage,
}

impl Evt2Decoder {
    /// A decoder at the start of a stream. Without a size, all addresses are taken.
    #[must_use]
    pub fn new(size: Option<SensorSize>) -> Self {
        let size = size.unwrap_or(SensorSize::ALL);
        Self {
            width: size.width,
            height: size.height,
            clock: LoopClock::default(),
            monitor: None,
            carry: Carry::default(),
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// What the decoder remembers at this point, for [`Evt2Decoder::from_state`]. Counts of anomalies and hints of the
    /// host's clock are not part of it.
    #[must_use]
    pub fn state(&self) -> [u8; 16] {
        let (high, flags) = self.clock.save();
        let mut bits = BitWriter::default();
        bits.put(high, 48);
        flags.put(&mut bits);
        bits.put(self.monitor.is_some(), 1);
        let (low, subtype) = self.monitor.unwrap_or_default();
        bits.put(low, 6);
        bits.put(subtype, 16);
        bits.carry(self.carry.bytes(), 3);
        bits.bytes()
    }

    /// A decoder that goes on where another one gave its `state`.
    #[must_use]
    pub fn from_state(state: [u8; 16], size: Option<SensorSize>) -> Self {
        let mut bits = BitReader::new(state);
        let mut decoder = Self::new(size);
        let high = bits.take(48);
        decoder.clock = LoopClock::restore(high, Flags::take(&mut bits));
        let monitor = bits.take(1) == 1;
        let (low, subtype) = (bits.take(6) as u8, bits.take(16) as u16);
        decoder.monitor = monitor.then_some((low, subtype));
        decoder.carry.hold(&bits.take_carry(3));
        decoder
    }

    /// Decodes as many words as are events inside the sensor, up to [`RUN`], all at once; tells whether they were.
    #[inline(always)]
    fn run(&mut self, words: &[[u8; 4]; RUN]) -> bool {
        let words = words.map(u32::from_le_bytes);
        let all_events = words.iter().fold(0, |all, word| all | word) >> 29 == 0;
        if !all_events {
            return false;
        }
        let (width, height) = (self.width, self.height);
        let high = self.clock.time_us();
        let Some((times, xs, ys, ons)) = self.stage.take::<RUN>() else { return false };
        *times = words.map(|word| high | u64::from(word >> 22 & 0x3F));
        *xs = words.map(|word| (word >> 11 & 0x7FF) as u16);
        *ys = words.map(|word| (word & 0x7FF) as u16);
        *ons = words.map(|word| word >> 28 != 0);
        let outside = xs.iter().zip(ys.iter()).fold(false, |any, (&x, &y)| any | (x >= width) | (y >= height));
        if outside {
            self.stage.give_back(RUN);
        }
        !outside
    }

    #[inline]
    fn words(&mut self, words: &[[u8; 4]], sink: &mut impl Sink) {
        let (runs, rest) = words.as_chunks::<RUN>();
        for run in runs {
            self.stage.room(RUN, sink);
            if self.monitor.is_some() || !self.clock.dated() || !self.run(run) {
                run.iter().for_each(|&word| self.word(word, sink));
            }
        }
        rest.iter().for_each(|&word| self.word(word, sink));
    }

    #[inline]
    fn word(&mut self, word: [u8; 4], sink: &mut impl Sink) {
        let word = u32::from_le_bytes(word);
        let kind = word >> 28;
        if kind != 15 {
            self.end_monitor(None, sink);
        }
        let low = (word >> 22 & 0x3F) as u8;
        match kind {
            0 | 1 => {
                let (x, y) = ((word >> 11 & 0x7FF) as u16, (word & 0x7FF) as u16);
                if !self.clock.dated() {
                    self.anomalies.undated += 1;
                } else if x < self.width && y < self.height {
                    self.stage.room(1, sink);
                    self.stage.push(self.clock.time_us() | u64::from(low), x, y, kind == 1);
                } else {
                    self.anomalies.outside += 1;
                }
            }
            8 => {
                if self.clock.step((word & 0xFFF_FFFF).into(), &mut self.anomalies) == Step::Discontinuity {
                    self.stage.flush(sink);
                    sink.discontinuity(self.clock.time_us());
                }
            }
            10 => {
                if self.clock.dated() {
                    self.stage.flush(sink);
                    let t_us = self.clock.time_us() | u64::from(low);
                    sink.edge(Edge { t_us, channel: (word >> 8 & 0x1F) as u8, rising: word & 1 == 1 });
                } else {
                    self.anomalies.undated += 1;
                }
            }
            14 => self.monitor = Some((low, word as u16)),
            15 if self.monitor.is_some() => self.end_monitor(Some(word & 0xFFF_FFFF), sink),
            15 => self.anomalies.incomplete += 1,
            _ => self.anomalies.unknown += 1,
        }
    }

    fn end_monitor(&mut self, payload: Option<u32>, sink: &mut impl Sink) {
        let Some((low, subtype)) = self.monitor.take() else { return };
        if self.clock.dated() {
            let t_us = self.clock.time_us() | u64::from(low);
            sink.monitor(t_us, subtype, payload.unwrap_or_default().into());
        } else {
            self.anomalies.undated += 1;
        }
    }
}

impl Decoder for Evt2Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut impl Sink) {
        let (first, words) = self.carry.split(bytes);
        if let Some(word) = first {
            self.word(word, sink);
        }
        self.words(words, sink);
        self.stage.flush(sink);
    }

    fn finish(&mut self, sink: &mut impl Sink) {
        self.anomalies.truncated_bytes += self.carry.drop();
        self.end_monitor(None, sink);
        self.stage.flush(sink);
    }

    fn restart(&mut self) {
        self.anomalies.truncated_bytes += self.carry.drop();
        self.anomalies.incomplete += u64::from(self.monitor.take().is_some());
        self.clock.restart();
    }

    fn hint_host_us(&mut self, host_us: u64) {
        self.clock.hint(host_us);
    }

    fn anomalies(&self) -> Anomalies {
        self.anomalies
    }
}

/// Encodes EVT 2.0.
///
/// A time word precedes the first event of each 64 µs, as decoders need it. A gap of more than 2^32 µs is bridged by
/// further time words, so that every decoder can follow; one of more than [`Evt2Encoder::MAX_GAP_US`] is marked by
/// nothing that the format has, and refused.
#[derive(Clone, Debug, Default)]
pub struct Evt2Encoder {
    high: Option<u64>,
}

impl Evt2Encoder {
    /// The longest gap between two events, microseconds: about a year.
    pub const MAX_GAP_US: u64 = 1 << 45;
    const STEP: u64 = 1 << 26;

    /// Appends an event.
    ///
    /// # Errors
    /// If the event goes back in time, or too far forward, or cannot be addressed.
    pub fn event(&mut self, event: CdEvent, out: &mut Vec<u8>) -> Result<(), super::super::EncodeError> {
        let CdEvent { t_us, x, y, on } = event;
        super::super::EncodeError::check_address(x, y, 0x7FF)?;
        self.time(t_us, out)?;
        let word = u32::from(on) << 28 | (t_us as u32 & 0x3F) << 22 | u32::from(x) << 11 | u32::from(y);
        out.extend(word.to_le_bytes());
        Ok(())
    }

    /// Appends an edge at a trigger input.
    ///
    /// # Errors
    /// As [`Evt2Encoder::event`]; channels end at 31.
    pub fn edge(&mut self, edge: Edge, out: &mut Vec<u8>) -> Result<(), super::super::EncodeError> {
        super::super::EncodeError::check_channel(edge.channel, 31)?;
        self.time(edge.t_us, out)?;
        let word = 10 << 28 | (edge.t_us as u32 & 0x3F) << 22 | u32::from(edge.channel) << 8 | u32::from(edge.rising);
        out.extend(word.to_le_bytes());
        Ok(())
    }

    fn time(&mut self, t_us: u64, out: &mut Vec<u8>) -> Result<(), super::super::EncodeError> {
        let high = t_us >> 6;
        let from = self.high.unwrap_or(high);
        super::super::EncodeError::check_time(from << 6, t_us, Self::MAX_GAP_US)?;
        if self.high == Some(high) {
            return Ok(());
        }
        let bridge = (from + Self::STEP..high).step_by(Self::STEP as usize);
        for high in bridge.chain([high]) {
            out.extend((8 << 28 | high as u32 & 0xFFF_FFFF).to_le_bytes());
        }
        self.high = Some(high);
        Ok(())
    }
}
