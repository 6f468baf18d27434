//! AEDAT 2 (jAER): a text header whose lines begin with `#`, then pairs of big-endian 32-bit words: address and
//! microseconds. Read, not written. (iniVation, "AEDAT file formats", AEDAT-2.0.)
//!
//! | chip | event if | column | row | polarity |
//! |---|---|---|---|---|
//! | DAVIS | bits 31 and 10 are 0 | bits 12 to 21 | bits 22 to 30 | bit 11, 1 = ON |
//! | DVS128 | bit 15 is 0 | bits 1 to 7 | bits 8 to 14 | bit 0, 0 = ON |
//!
//! The file counts rows from the bottom and columns from the right (jAER, and v2e's files); here rows count from the top and columns
//! from the left. Samples of frames and of the inertial unit (bit 31) are skipped. On a DAVIS, bit 10 alone marks an edge
//! of the external input (its direction is not recorded).

use super::{
    Anomalies, Decoder, Edge, SensorSize, Sink,
    carry::Carry,
    evt::BYTE_ORDER_MARK,
    stage::Stage,
    state::{BitReader, BitWriter},
};

/// The last line of a header, where there is one, in small letters.
const LAST_LINE: &str = "end of ascii header";

/// The chip whose addresses a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aedat2Chip {
    /// A DAVIS of this size.
    Davis(SensorSize),
    /// The DVS128.
    Dvs128,
}

impl Aedat2Chip {
    /// Size of the sensor.
    #[must_use]
    pub fn size(self) -> SensorSize {
        match self {
            Self::Davis(size) => size,
            Self::Dvs128 => SensorSize { width: 128, height: 128 },
        }
    }

    /// Reads the header: the chip, if its lines name one that is known, the lines, and where the events begin.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> (Option<Self>, Vec<(String, String)>, usize) {
        let start = if bytes.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
        let (mut at, mut chip, mut fields) = (start, None, Vec::new());
        while bytes.get(at) == Some(&b'#') {
            let line = &bytes[at..];
            let Some(length) = line.iter().position(|&byte| byte == b'\n') else { break };
            let text = String::from_utf8_lossy(&line[1..length]).trim().to_owned();
            at += length + 1;
            let name = text.to_ascii_lowercase();
            if name.contains("dvs128") {
                chip = chip.or(Some(Self::Dvs128));
            } else if name.contains("davis") {
                let davis = |width, height| Some(Self::Davis(SensorSize { width, height }));
                chip = chip.or(match () {
                    () if name.contains("346") => davis(346, 260),
                    () if name.contains("240") => davis(240, 180),
                    () if name.contains("640") => davis(640, 480),
                    () if name.contains("128") => davis(128, 128),
                    () => None,
                });
            }
            let (key, value) = text.split_once(':').unwrap_or((&text, ""));
            fields.push((key.trim().to_owned(), value.trim().to_owned()));
            // The first address may begin with the byte of a `#`.
            if name == LAST_LINE {
                break;
            }
        }
        (chip, fields, at)
    }
}

/// Decodes the pairs of an AEDAT 2 file. Time has 32 bits, of which jAER uses 31; a step back by more than 2^30 is a
/// roll-over, a shorter one is kept and counted.
#[derive(Clone, Debug)]
pub struct Aedat2Decoder {
    chip: Aedat2Chip,
    last_us: Option<u64>,
    restarted: bool,
    carry: Carry<8>,
    anomalies: Anomalies,
    stage: Stage,
}

impl Aedat2Decoder {
    /// A decoder at the first pair.
    #[must_use]
    pub fn new(chip: Aedat2Chip) -> Self {
        Self {
            chip,
            last_us: None,
            restarted: false,
            carry: Carry::default(),
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// What the decoder remembers at this point, for [`Aedat2Decoder::from_state`]. Counts of anomalies are not part of
    /// it.
    #[must_use]
    pub fn state(&self) -> [u8; 16] {
        let mut bits = BitWriter::default();
        bits.put(self.last_us.is_some(), 1);
        bits.put(self.restarted, 1);
        bits.put(self.last_us.unwrap_or(0), 60);
        bits.carry(self.carry.bytes(), 7);
        bits.bytes()
    }

    /// A decoder that goes on where another one gave its `state`.
    #[must_use]
    pub fn from_state(state: [u8; 16], chip: Aedat2Chip) -> Self {
        let mut bits = BitReader::new(state);
        let mut decoder = Self::new(chip);
        let known = bits.take(1) == 1;
        decoder.restarted = bits.take(1) == 1;
        let last_us = bits.take(60);
        decoder.last_us = known.then_some(last_us);
        decoder.carry.hold(&bits.take_carry(7));
        decoder
    }

    fn pair(&mut self, pair: [u8; 8], sink: &mut impl Sink) {
        let pair = u64::from_be_bytes(pair);
        let (address, t) = ((pair >> 32) as u32, pair as u32 & 0x7FFF_FFFF);
        let last = self.last_us.unwrap_or(t.into());
        let mut step = i64::from(t) - (last & 0x7FFF_FFFF) as i64;
        if step < -(1 << 30) {
            step += 1 << 31;
        }
        self.anomalies.time_backward += u64::from(step < 0);
        let t_us = last.saturating_add_signed(step);
        self.last_us = Some(t_us);
        if self.restarted {
            self.restarted = false;
            self.anomalies.discontinuities += 1;
            self.stage.flush(sink);
            sink.discontinuity(t_us);
        }
        let (x, y, on) = match self.chip {
            Aedat2Chip::Davis(_) if address >> 31 == 1 => return,
            Aedat2Chip::Davis(_) if address >> 10 & 1 == 1 => {
                self.stage.flush(sink);
                return sink.edge(Edge { t_us, channel: 0, rising: true });
            }
            Aedat2Chip::Davis(size) => {
                let (x, y) = ((address >> 12 & 0x3FF) as u16, (address >> 22 & 0x1FF) as u16);
                // What is beyond an edge wraps to far beyond the other.
                (size.width.wrapping_sub(1 + x), size.height.wrapping_sub(1 + y), address >> 11 & 1 == 1)
            }
            Aedat2Chip::Dvs128 if address >> 15 != 0 => {
                self.stage.flush(sink);
                return sink.edge(Edge { t_us, channel: 0, rising: true });
            }
            Aedat2Chip::Dvs128 => {
                let (x, y) = ((address >> 1 & 0x7F) as u16, (address >> 8 & 0x7F) as u16);
                (127 - x, 127 - y, address & 1 == 0)
            }
        };
        let size = self.chip.size();
        if x < size.width && y < size.height {
            self.stage.room(1, sink);
            self.stage.push(t_us, x, y, on);
        } else {
            self.anomalies.outside += 1;
        }
    }
}

impl Decoder for Aedat2Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut impl Sink) {
        let (first, pairs) = self.carry.split(bytes);
        first.iter().chain(pairs).for_each(|&pair| self.pair(pair, sink));
        self.stage.flush(sink);
    }

    fn finish(&mut self, sink: &mut impl Sink) {
        self.anomalies.truncated_bytes += self.carry.drop();
        self.stage.flush(sink);
    }

    fn restart(&mut self) {
        self.anomalies.truncated_bytes += self.carry.drop();
        self.restarted = self.last_us.is_some();
    }

    /// The format comes from files alone and needs no host clock.
    fn hint_host_us(&mut self, _host_us: u64) {}

    fn anomalies(&self) -> Anomalies {
        self.anomalies
    }
}
