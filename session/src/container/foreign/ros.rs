//! `event_camera_msgs/msg/EventPacket` of ROS 2: the words of an event camera in a message.
//!
//! Fields in the order of the message definition, as CDR lays them out: header (stamp, frame_id), height, width, seq,
//! time_base, encoding, is_bigendian, events. See the README of ros-event-camera/event_camera_msgs for the encodings.

use bytes::{Buf, Bytes};

use crate::source::{Description, Encoding};
use erfgs_events::EventEncoding;
use erfgs_events::{CdEvent, EncodeError, Evt3Encoder};

/// Name of the schema.
pub(in crate::container) const SCHEMA_NAME: &str = "event_camera_msgs/msg/EventPacket";

/// The setting of a stream that says in which encoding its first message was.
pub(in crate::container) const RECORDED_ENCODING: &str = "recorded_encoding";

/// One message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::container) struct EventPacket {
    pub frame_id: String,
    pub height: u32,
    pub width: u32,
    pub sequence: u64,
    pub time_base: u64,
    pub encoding: String,
    pub events: Bytes,
}

impl EventPacket {
    /// From the bytes of a message.
    ///
    /// # Errors
    /// What it is that is not read: it is cut, not in plain CDR, or has its numbers the other way round.
    pub fn parse(message: &Bytes) -> Result<Self, String> {
        match message.get(..2) {
            None | Some([0, 1]) => {}
            Some(kind) => {
                return Err(format!(
                    "an EventPacket is not in little-endian CDR (its kind is {}, {})",
                    kind[0], kind[1]
                ));
            }
        }
        let (packet, is_big_endian) = Self::fields(message).ok_or("an EventPacket is shorter than its fields say")?;
        match is_big_endian {
            0 => Ok(packet),
            _ => Err(format!(
                "an EventPacket has big-endian events (is_bigendian = {is_big_endian}), which erfgs does not read"
            )),
        }
    }

    /// The fields, and whether the events are big-endian; `None` if it is cut.
    fn fields(message: &Bytes) -> Option<(Self, u8)> {
        let mut cdr = Cdr { left: message.slice(4.min(message.len())..), taken: 0 };
        cdr.u32()?;
        cdr.u32()?;
        let frame_id = cdr.string()?;
        let height = cdr.u32()?;
        let width = cdr.u32()?;
        let sequence = cdr.u64()?;
        let time_base = cdr.u64()?;
        let encoding = cdr.string()?;
        let is_big_endian = cdr.take(1)?[0];
        let count = cdr.u32()? as usize;
        let events = cdr.take(count)?;
        Some((Self { frame_id, height, width, sequence, time_base, encoding, events }, is_big_endian))
    }

    /// The encoding, if it is one that erfgs decodes. What is no stream of words of its own is handed on as EVT 3.
    pub fn known_encoding(&self) -> Option<Encoding> {
        match self.encoding.as_str() {
            "evt3" => Some(Encoding::Events(EventEncoding::Evt3)),
            "evt2" => Some(Encoding::Events(EventEncoding::Evt2)),
            "evt21" => Some(Encoding::Events(EventEncoding::Evt21)),
            other => Transcoded::named(other).map(|_| Encoding::Events(EventEncoding::Evt3)),
        }
    }

    /// What sets it apart from the first message of its stream, whose words would be taken for others.
    pub fn differs_from(&self, stream: &Description) -> Option<String> {
        let first = stream.settings.get(RECORDED_ENCODING).and_then(serde_json::Value::as_str).unwrap_or_default();
        let (size, first_size) = ([self.width, self.height], [stream.width, stream.height]);
        if self.encoding != first {
            return Some(format!("an EventPacket is of '{}' in a topic of '{first}'", self.encoding));
        }
        (size != first_size).then(|| {
            let [[width, height], [first_width, first_height]] = [size, first_size];
            format!("an EventPacket is of {width} x {height} pixels in a topic of {first_width} x {first_height}")
        })
    }

    /// The words, in [`EventPacket::known_encoding`].
    ///
    /// # Errors
    /// What of them cannot be handed on.
    pub fn words(self) -> Result<Bytes, String> {
        match Transcoded::named(&self.encoding) {
            Some(encoding) => self.transcoded(encoding),
            None => Ok(self.events),
        }
    }

    /// The events as EVT 3.
    fn transcoded(&self, encoding: Transcoded) -> Result<Bytes, String> {
        let (bytes, word) = (self.events.len(), encoding.word());
        if !bytes.is_multiple_of(word) {
            return Err(format!(
                "an EventPacket of {} has {bytes} bytes of events, no whole words of {word}",
                self.encoding
            ));
        }
        let mut writer = Writer {
            base_ns: self.time_base,
            encoder: Evt3Encoder::default(),
            last_us: 0,
            out: Vec::with_capacity(2 * self.events.len()),
            refused: None,
        };
        match encoding {
            Transcoded::LibcaerCmp => writer.libcaer_cmp(&self.events),
            Transcoded::Libcaer => writer.libcaer(&self.events),
            Transcoded::Mono => writer.mono(&self.events),
        }
        writer.encoder.finish(&mut writer.out);
        match writer.refused {
            Some(refused) => Err(format!("an EventPacket of {}: {refused}", self.encoding)),
            None => Ok(writer.out.into()),
        }
    }
}

/// Encodings whose events are handed on as EVT 3. (ros-event-camera/event_camera_codecs, and the README of
/// event_camera_msgs.)
#[derive(Clone, Copy)]
enum Transcoded {
    /// iniVation's events as the ROS driver of libcaer packs them.
    LibcaerCmp,
    /// iniVation's events as libcaer has them.
    Libcaer,
    /// Events of 64 bits, of the first drivers.
    Mono,
}

impl Transcoded {
    fn named(name: &str) -> Option<Self> {
        match name {
            "libcaer_cmp" => Some(Self::LibcaerCmp),
            "libcaer" => Some(Self::Libcaer),
            "mono" => Some(Self::Mono),
            _ => None,
        }
    }

    /// Bytes of a word.
    fn word(self) -> usize {
        match self {
            Self::LibcaerCmp => 2,
            Self::Libcaer | Self::Mono => 8,
        }
    }
}

/// Writes the events of one message as EVT 3.
struct Writer {
    /// The message's time base, nanoseconds.
    base_ns: u64,
    encoder: Evt3Encoder,
    last_us: u64,
    out: Vec<u8>,
    /// The first event that EVT 3 cannot hold.
    refused: Option<String>,
}

impl Writer {
    /// An event, at a time of which only what the 24 bits of EVT 3's clock hold matters. Those outside of the sensor are counted where
    /// they are decoded; what is refused are addresses of more than 11 bits: time does not go back, and a packet is shorter than any gap.
    fn event(&mut self, t_us: u64, x: u16, y: u16, on: bool) {
        self.last_us = self.last_us.max(t_us);
        let event = CdEvent { t_us: self.last_us, x, y, on };
        if let Err(error) = self.encoder.event(event, &mut self.out) {
            self.refused.get_or_insert_with(|| match error {
                EncodeError::Address { .. } => {
                    format!("its event at ({x}, {y}) is outside of any sensor that erfgs reads")
                }
                error => error.to_string(),
            });
        }
    }

    /// Microseconds of a time in nanoseconds, from the round of EVT 3's clock on in which the message begins.
    fn in_round(&self, ns: u64) -> u64 {
        let rounds_us = self.base_ns / 1000 / ROUND_US * ROUND_US;
        (ns / 1000).saturating_sub(rounds_us)
    }

    /// 16-bit little-endian words, a type in the high 4 bits. 0 and 1 are the high and the low 12 bits of the time, microseconds
    /// after the time base; 2 is the column; 3 an event in a row, polarity in bit 11; 4 the first row and polarity of what 5
    /// has in its low 8 bits, a bit for each of the next 8 rows.
    fn libcaer_cmp(&mut self, words: &[u8]) {
        let base_us = self.base_ns / 1000 % ROUND_US;
        let (mut high, mut low) = (0, 0);
        let (mut x, mut row, mut on) = (0, 0, false);
        for word in words.as_chunks::<2>().0 {
            let word = u16::from_le_bytes(*word);
            let t_us = base_us + (high | low);
            match word >> 12 {
                0 => high = u64::from(word & 0xFFF) << 12,
                1 => low = u64::from(word & 0xFFF),
                2 => x = word & 0x7FF,
                3 => self.event(t_us, x, word & 0x7FF, word & 0x800 != 0),
                4 => (row, on) = (word & 0x7FF, word & 0x800 != 0),
                5 => {
                    for bit in (0..8).filter(|bit| word >> bit & 1 == 1) {
                        self.event(t_us, x, row + bit, on);
                    }
                    row = (row + 8).min(0x7FF);
                }
                _ => {}
            }
        }
    }

    /// Pairs of 32-bit little-endian words: bit 1 is the polarity, bits 2 to 16 the row, bits 17 to 31 the column; then
    /// microseconds after the time base, of 31 bits, which may pass their end once.
    fn libcaer(&mut self, pairs: &[u8]) {
        let (mut rounds, mut last) = (0_u64, 0);
        for pair in pairs.as_chunks::<8>().0 {
            let pair = u64::from_le_bytes(*pair);
            let (data, low) = (pair as u32, (pair >> 32) as u32 & 0x7FFF_FFFF);
            rounds += u64::from(low < last) << 31;
            last = low;
            let t_ns = self.base_ns.saturating_add(rounds.saturating_add(low.into()).saturating_mul(1000));
            let t_us = self.in_round(t_ns);
            self.event(t_us, (data >> 17 & 0x7FFF) as u16, (data >> 2 & 0x7FFF) as u16, data & 2 != 0);
        }
    }

    /// 64-bit little-endian words: bits 0 to 31 are nanoseconds after the time base, bits 32 to 47 the column, bits 48 to 62
    /// the row, bit 63 the polarity.
    fn mono(&mut self, words: &[u8]) {
        for word in words.as_chunks::<8>().0 {
            let word = u64::from_le_bytes(*word);
            let t_us = self.in_round(self.base_ns.saturating_add(word & 0xFFFF_FFFF));
            self.event(t_us, (word >> 32) as u16, (word >> 48 & 0x7FFF) as u16, word >> 63 == 1);
        }
    }
}

/// After so many microseconds the clock of EVT 3 begins anew.
const ROUND_US: u64 = 1 << 24;

/// Fields of CDR, which lie at multiples of their size.
struct Cdr {
    left: Bytes,
    taken: usize,
}

impl Cdr {
    fn take(&mut self, count: usize) -> Option<Bytes> {
        (count <= self.left.len()).then(|| {
            self.taken += count;
            self.left.split_to(count)
        })
    }

    fn align(&mut self, size: usize) -> Option<()> {
        self.take((size - self.taken % size) % size).map(drop)
    }

    fn u32(&mut self) -> Option<u32> {
        self.align(4)?;
        Some(self.take(4)?.get_u32_le())
    }

    fn u64(&mut self) -> Option<u64> {
        self.align(8)?;
        Some(self.take(8)?.get_u64_le())
    }

    fn string(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        let bytes = self.take(length)?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(&bytes);
        String::from_utf8(text.to_vec()).ok()
    }
}
