//! EVT 2.1: 64-bit words, each of them an EVT 2.0 word with 32 bits of payload. (Prophesee, "EVT 2.1 Format".)
//!
//! | type | name | content |
//! |---|---|---|
//! | 0, 1 | `EVT_NEG`, `EVT_POS` | low 6 bits of the time, first column, row; one payload bit for each of 32 columns |
//! | 8 | `EVT_TIME_HIGH` | the time without its low 6 bits; rolls over every 4 h 46 min |
//! | 10 | `EXT_TRIGGER` | low 6 bits of the time, channel in 5 bits, edge in 1 |
//! | 14 | `OTHERS` | low 6 bits of the time, subtype in 16 bits; a payload of 28 bits if its high 4 bits are set |

use super::super::{
    Anomalies, CdEvent, Decoder, Edge, EncodeError, SensorSize, Sink,
    carry::Carry,
    clock::{Flags, LoopClock, Step},
    encode::Vector,
    stage::Stage,
    state::{BitReader, BitWriter},
};

/// Which half of a 64-bit word comes first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WordOrder {
    /// The payload, then type, time and address: a little-endian 64-bit word (GenX320).
    #[default]
    Little,
    /// Type, time and address, then the payload ("legacy": IMX636).
    Legacy,
}

/// Decodes EVT 2.1.
#[derive(Clone, Debug)]
pub struct Evt21Decoder {
    order: WordOrder,
    width: u16,
    height: u16,
    clock: LoopClock<28, 6>,
    carry: Carry<8>,
    anomalies: Anomalies,
    stage: Stage,
}

impl Evt21Decoder {
    /// A decoder at the start of a stream. Without a size, all addresses are taken.
    #[must_use]
    pub fn new(order: WordOrder, size: Option<SensorSize>) -> Self {
        let size = size.unwrap_or(SensorSize::ALL);
        Self {
            order,
            width: size.width,
            height: size.height,
            clock: LoopClock::default(),
            carry: Carry::default(),
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// What the decoder remembers at this point, for [`Evt21Decoder::from_state`]. Counts of anomalies and hints of the
    /// host's clock are not part of it.
    #[must_use]
    pub fn state(&self) -> [u8; 16] {
        let (high, flags) = self.clock.save();
        let mut bits = BitWriter::default();
        bits.put(high, 48);
        flags.put(&mut bits);
        bits.carry(self.carry.bytes(), 7);
        bits.bytes()
    }

    /// A decoder that goes on where another one gave its `state`.
    #[must_use]
    pub fn from_state(state: [u8; 16], order: WordOrder, size: Option<SensorSize>) -> Self {
        let mut bits = BitReader::new(state);
        let mut decoder = Self::new(order, size);
        let high = bits.take(48);
        decoder.clock = LoopClock::restore(high, Flags::take(&mut bits));
        decoder.carry.hold(&bits.take_carry(7));
        decoder
    }

    #[inline(always)]
    fn word(&mut self, word: [u8; 8], sink: &mut impl Sink) {
        let word = u64::from_le_bytes(word);
        let (low_half, high_half) = (word as u32, (word >> 32) as u32);
        let (head, payload) = match self.order {
            WordOrder::Little => (high_half, low_half),
            WordOrder::Legacy => (low_half, high_half),
        };
        let t_us = self.clock.time_us() | u64::from(head >> 22 & 0x3F);
        match head >> 28 {
            kind @ (0 | 1) => {
                let (base, y) = ((head >> 11 & 0x7FF) as u16, (head & 0x7FF) as u16);
                self.vector(t_us, base, y, kind == 1, payload, sink);
            }
            8 => {
                if self.clock.step((head & 0xFFF_FFFF).into(), &mut self.anomalies) == Step::Discontinuity {
                    self.stage.flush(sink);
                    sink.discontinuity(self.clock.time_us());
                }
            }
            10 | 14 if !self.clock.dated() => self.anomalies.undated += 1,
            10 => {
                self.stage.flush(sink);
                sink.edge(Edge { t_us, channel: (head >> 8 & 0x1F) as u8, rising: head & 1 == 1 });
            }
            14 => {
                let payload = if payload >> 28 == 15 { payload & 0xFFF_FFFF } else { 0 };
                sink.monitor(t_us, head as u16, payload.into());
            }
            _ => self.anomalies.unknown += 1,
        }
    }

    #[inline(always)]
    fn vector(&mut self, t_us: u64, base: u16, y: u16, on: bool, mask: u32, sink: &mut impl Sink) {
        if !self.clock.dated() {
            self.anomalies.undated += u64::from(mask.count_ones());
            return;
        }
        let inside = if y < self.height { self.width.saturating_sub(base).min(32) } else { 0 };
        let visible = mask & ((1_u64 << inside) - 1) as u32;
        self.anomalies.outside += u64::from((mask & !visible).count_ones());
        self.stage.push_columns(t_us, base, y, on, visible, sink);
    }
}

impl Decoder for Evt21Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut impl Sink) {
        let (first, words) = self.carry.split(bytes);
        first.iter().chain(words).for_each(|&word| self.word(word, sink));
        self.stage.flush(sink);
    }

    fn finish(&mut self, sink: &mut impl Sink) {
        self.anomalies.truncated_bytes += self.carry.drop();
        self.stage.flush(sink);
    }

    fn restart(&mut self) {
        self.anomalies.truncated_bytes += self.carry.drop();
        self.clock.restart();
    }

    fn hint_host_us(&mut self, host_us: u64) {
        self.clock.hint(host_us);
    }

    fn anomalies(&self) -> Anomalies {
        self.anomalies
    }
}

/// Encodes EVT 2.1. Events that one word can hold are gathered, so that [`Evt21Encoder::finish`] must be called last.
#[derive(Clone, Debug, Default)]
pub struct Evt21Encoder {
    order: WordOrder,
    high: Option<u64>,
    pending: Option<Vector>,
}

impl Evt21Encoder {
    /// The longest gap between two events, microseconds: about a year.
    pub const MAX_GAP_US: u64 = 1 << 45;
    const STEP: u64 = 1 << 26;

    /// An encoder of words in this order.
    #[must_use]
    pub fn new(order: WordOrder) -> Self {
        Self { order, ..Self::default() }
    }

    /// Appends an event.
    ///
    /// # Errors
    /// If the event goes back in time, or too far forward, or cannot be addressed.
    pub fn event(&mut self, event: CdEvent, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        EncodeError::check_address(event.x, event.y, 0x7FF)?;
        if self.pending.as_mut().is_some_and(|vector| vector.extend(event)) {
            return Ok(());
        }
        self.finish(out);
        self.time(event.t_us, out)?;
        self.pending = Some(Vector::new(event, 32));
        Ok(())
    }

    /// Appends an edge at a trigger input.
    ///
    /// # Errors
    /// As [`Evt21Encoder::event`]; channels end at 31.
    pub fn edge(&mut self, edge: Edge, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        EncodeError::check_channel(edge.channel, 31)?;
        self.finish(out);
        self.time(edge.t_us, out)?;
        let head = 10 << 28 | (edge.t_us as u32 & 0x3F) << 22 | u32::from(edge.channel) << 8 | u32::from(edge.rising);
        self.word(head, 0, out);
        Ok(())
    }

    /// Appends what is gathered.
    pub fn finish(&mut self, out: &mut Vec<u8>) {
        if let Some(Vector { t_us, y, on, base, mask }) = self.pending.take() {
            let head = u32::from(on) << 28 | (t_us as u32 & 0x3F) << 22 | u32::from(base) << 11 | u32::from(y);
            self.word(head, mask, out);
        }
    }

    fn time(&mut self, t_us: u64, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        let high = t_us >> 6;
        let from = self.high.unwrap_or(high);
        EncodeError::check_time(from << 6, t_us, Self::MAX_GAP_US)?;
        if self.high != Some(high) {
            let bridge = (from + Self::STEP..high).step_by(Self::STEP as usize);
            for high in bridge.chain([high]) {
                self.word(8 << 28 | high as u32 & 0xFFF_FFFF, 0, out);
            }
            self.high = Some(high);
        }
        Ok(())
    }

    fn word(&self, head: u32, payload: u32, out: &mut Vec<u8>) {
        let halves = match self.order {
            WordOrder::Little => [payload, head],
            WordOrder::Legacy => [head, payload],
        };
        out.extend(halves.into_iter().flat_map(u32::to_le_bytes));
    }
}
