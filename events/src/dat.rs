//! DAT, versions 1 and 2: after a text header, two bytes (type of the items, size 8) and items of 8 bytes, little-endian:
//! time in 32 bits, then column, row and payload packed in 32 bits. (Prophesee, "DAT File Format".)
//!
//! | | column | row | payload |
//! |---|---|---|---|
//! | version 1 | 9 bits | 8 bits | 4 bits |
//! | version 2 | 14 bits | 14 bits | 4 bits |
//!
//! For trigger items the payload's place holds the edge in bit 0 and the channel in bits 8 to 12.

use super::{
    Anomalies, CdEvent, Decoder, Edge, EncodeError, RawHeader, SensorSize, Sink,
    carry::Carry,
    stage::Stage,
    state::{BitReader, BitWriter},
};

/// What the items of a DAT file are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DatItems {
    /// Events (types 0x00 and 0x0C).
    #[default]
    Events,
    /// Edges at trigger inputs (type 0x0E).
    Triggers,
}

/// Version and type of a DAT file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DatFormat {
    /// 1 or 2.
    pub version: u8,
    /// What the items are.
    pub items: DatItems,
    /// Size of the sensor, where the header says it.
    pub size: Option<SensorSize>,
}

impl DatFormat {
    /// Reads the header; gives the keys and where the items begin as well. Where a header has no version, as the first files
    /// had none, the items that `bytes` holds behind it tell: version 1 leaves bits at 0 that version 2 uses.
    ///
    /// # Errors
    /// What is wrong or contradicts itself, and at which byte.
    pub fn parse(bytes: &[u8]) -> Result<(Self, RawHeader, usize), (usize, String)> {
        let (header, at) = RawHeader::parse(bytes);
        let Some(&[kind, size]) = bytes.get(at..at + 2) else {
            return Err((at, "the file ends before the type of its items".to_owned()));
        };
        let declared = match header.get("Version").or(header.get("version")) {
            None => None,
            Some("1") => Some(1),
            Some("2") => Some(2),
            Some(other) => return Err((0, format!("version {other} is unknown; 1 and 2 are read"))),
        };
        let items = match kind {
            0x00 | 0x0C => DatItems::Events,
            0x0E => DatItems::Triggers,
            _ => return Err((at, format!("items of type {kind:#04x} are unknown; 0x00, 0x0c and 0x0e are read"))),
        };
        if size != 8 {
            return Err((at + 1, format!("items of {size} bytes are unknown; they have 8")));
        }
        let side = |key: &str| match header.get(key).or(header.get(&key.to_ascii_lowercase())) {
            None => Ok(None),
            Some(text) => match text.parse() {
                Ok(side @ 1..) => Ok(Some(side)),
                _ => Err((0, format!("its {key} `{text}` is no number of pixels; correct the line or remove it"))),
            },
        };
        let size = side("Width")?.zip(side("Height")?).map(|(width, height)| SensorSize { width, height });
        let version = match items {
            DatItems::Events => {
                version(declared, size, &bytes[at + 2..]).map_err(|(item, what)| (at + 2 + item, what))?
            }
            DatItems::Triggers => declared.unwrap_or(1),
        };
        Ok((Self { version, items, size }, header, at + 2))
    }

    /// The header of a new file of version 2 with events.
    #[must_use]
    pub fn header(size: SensorSize, date: &str) -> Vec<u8> {
        let date = date.replace(['\r', '\n'], " ");
        let text = format!(
            "% Data file containing CD events.\n% Version 2\n% Date {date}\n% Height {}\n% Width {}\n% end\n",
            size.height, size.width
        );
        [text.as_bytes(), &[0x0C, 8]].concat()
    }
}

/// Bits that version 1 leaves at 0.
const UNUSED_BY_1: u32 = 21;

/// Column, row and payload of an item.
#[inline(always)]
fn address(version: u8, packed: u32) -> (u16, u16, u32) {
    match version {
        1 => ((packed & 0x1FF) as u16, (packed >> 9 & 0xFF) as u16, packed >> 17 & 0xF),
        _ => ((packed & 0x3FFF) as u16, (packed >> 14 & 0x3FFF) as u16, packed >> 28),
    }
}

/// The version of items of events: as declared, if they do not contradict it, else as they tell.
fn version(declared: Option<u8>, size: Option<SensorSize>, items: &[u8]) -> Result<u8, (usize, String)> {
    let packed = || items.as_chunks::<8>().0.iter().map(|&[.., a, b, c, d]| u32::from_le_bytes([a, b, c, d]));
    let of_2 = packed().position(|packed| packed >> UNUSED_BY_1 != 0);
    let outside = |version: u8| {
        let lies_outside = |packed| {
            let (x, y, _) = address(version, packed);
            size.is_some_and(|size| x >= size.width || y >= size.height)
        };
        packed().filter(|&packed| lies_outside(packed)).count()
    };
    match (declared, of_2) {
        (Some(1), Some(item)) => {
            let what = format!(
                "its header says version 1, and item {item} uses bits that version 1 leaves at 0: correct the line to `% Version 2`"
            );
            Err((item * 8, what))
        }
        (Some(2), None) if outside(2) * 2 > packed().count() && outside(1) == 0 => {
            let what = "its header says version 2, and most items lie outside its sensor unless they are of version 1: correct the \
                        line to `% Version 1`";
            Err((0, what.to_owned()))
        }
        (Some(version), _) => Ok(version),
        (None, Some(_)) => Ok(2),
        (None, None) => Ok(1),
    }
}

/// Decodes the items of a DAT file.
///
/// Time has 32 bits and rolls over every 71.6 min. A step back by more than half of that is a roll-over; a shorter one is
/// kept as it is and counted.
#[derive(Clone, Debug)]
pub struct DatDecoder {
    version: u8,
    items: DatItems,
    size: SensorSize,
    /// The last item's time with roll-overs.
    last_us: Option<u64>,
    /// A gap before the next item is to be marked.
    restarted: bool,
    carry: Carry<8>,
    anomalies: Anomalies,
    stage: Stage,
}

impl DatDecoder {
    /// A decoder at the first item. Without a size, all addresses are taken.
    #[must_use]
    pub fn new(format: DatFormat) -> Self {
        Self {
            version: format.version,
            items: format.items,
            size: format.size.unwrap_or(SensorSize { width: 1 << 14, height: 1 << 14 }),
            last_us: None,
            restarted: false,
            carry: Carry::default(),
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// What the decoder remembers at this point, for [`DatDecoder::from_state`]. Counts of anomalies are not part of it.
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
    pub fn from_state(state: [u8; 16], format: DatFormat) -> Self {
        let mut bits = BitReader::new(state);
        let mut decoder = Self::new(format);
        let known = bits.take(1) == 1;
        decoder.restarted = bits.take(1) == 1;
        let last_us = bits.take(60);
        decoder.last_us = known.then_some(last_us);
        decoder.carry.hold(&bits.take_carry(7));
        decoder
    }

    /// Time with its roll-overs.
    #[inline(always)]
    fn time(&mut self, t: u32, sink: &mut impl Sink) -> u64 {
        let last = self.last_us.unwrap_or(t.into());
        let step = i64::from(t.wrapping_sub(last as u32) as i32);
        let mut t_us = last.saturating_add_signed(step);
        if t_us as u32 != t {
            // Before zero: only a file whose first items go back can want that.
            t_us = t.into();
        }
        self.anomalies.time_backward += u64::from(step < 0);
        self.last_us = Some(t_us);
        if self.restarted {
            self.restarted = false;
            self.anomalies.discontinuities += 1;
            self.stage.flush(sink);
            sink.discontinuity(t_us);
        }
        t_us
    }

    #[inline(always)]
    fn item(&mut self, item: [u8; 8], sink: &mut impl Sink) {
        let item = u64::from_le_bytes(item);
        let t_us = self.time(item as u32, sink);
        let packed = (item >> 32) as u32;
        if self.items == DatItems::Triggers {
            self.stage.flush(sink);
            return sink.edge(Edge { t_us, channel: (packed >> 8 & 0x1F) as u8, rising: packed & 1 == 1 });
        }
        let (x, y, payload) = address(self.version, packed);
        if x < self.size.width && y < self.size.height {
            self.stage.room(1, sink);
            self.stage.push(t_us, x, y, payload & 1 == 1);
        } else {
            self.anomalies.outside += 1;
        }
    }
}

impl Decoder for DatDecoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut impl Sink) {
        let (first, items) = self.carry.split(bytes);
        first.iter().chain(items).for_each(|&item| self.item(item, sink));
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

/// Encodes events as items of version 2, to follow [`DatFormat::header`].
#[derive(Clone, Debug, Default)]
pub struct DatEncoder {
    last_us: u64,
}

impl DatEncoder {
    /// The longest gap between two events, microseconds: decoders must tell a roll-over from a step back.
    pub const MAX_GAP_US: u64 = (1 << 31) - 1;

    /// Appends an event. The first event's time must fit 32 bits, or its higher bits are lost.
    ///
    /// # Errors
    /// If the event goes back in time, or too far forward, or cannot be addressed.
    pub fn event(&mut self, event: CdEvent, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        let CdEvent { t_us, x, y, on } = event;
        EncodeError::check_address(x, y, 0x3FFF)?;
        let before = if self.last_us == 0 { t_us } else { self.last_us };
        EncodeError::check_time(before, t_us, Self::MAX_GAP_US)?;
        self.last_us = t_us;
        out.extend((t_us as u32).to_le_bytes());
        out.extend((u32::from(on) << 28 | u32::from(y) << 14 | u32::from(x)).to_le_bytes());
        Ok(())
    }
}
