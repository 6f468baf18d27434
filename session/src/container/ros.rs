//! `event_camera_msgs/msg/EventPacket` of ROS 2: the words of an event camera in a message.
//!
//! Fields in the order of the message definition, as CDR lays them out: header (stamp, frame_id), height, width, seq,
//! time_base, encoding, is_bigendian, events. See the README of ros-event-camera/event_camera_msgs for the encodings.

use bytes::{Buf, Bytes};

use crate::source::Encoding;
use erfgs_events::EventEncoding;
use erfgs_events::{CdEvent, Evt3Encoder};

/// Name of the schema.
pub(super) const SCHEMA_NAME: &str = "event_camera_msgs/msg/EventPacket";

/// One message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct EventPacket {
    pub frame_id: String,
    pub height: u32,
    pub width: u32,
    pub sequence: u64,
    pub time_base: u64,
    pub encoding: String,
    pub events: Bytes,
}

impl EventPacket {
    /// From the bytes of a message; `None` if it is cut or not little-endian CDR.
    pub fn parse(message: &Bytes) -> Option<Self> {
        if message.get(..2)? != [0, 1] {
            return None;
        }
        let mut cdr = Cdr { left: message.slice(4.min(message.len())..), taken: 0 };
        cdr.u32()?;
        cdr.u32()?;
        let frame_id = cdr.string()?;
        let height = cdr.u32()?;
        let width = cdr.u32()?;
        let sequence = cdr.u64()?;
        let time_base = cdr.u64()?;
        let encoding = cdr.string()?;
        cdr.take(1)?;
        let count = cdr.u32()? as usize;
        let events = cdr.take(count)?;
        Some(Self { frame_id, height, width, sequence, time_base, encoding, events })
    }

    /// The encoding, if it is one that erfgs decodes. libcaer's words are handed on as EVT 3.
    pub fn known_encoding(&self) -> Option<Encoding> {
        match self.encoding.as_str() {
            "evt3" | LIBCAER_CMP => Some(Encoding::Events(EventEncoding::Evt3)),
            "evt2" => Some(Encoding::Events(EventEncoding::Evt2)),
            "evt21" => Some(Encoding::Events(EventEncoding::Evt21)),
            _ => None,
        }
    }

    /// The words, in [`EventPacket::known_encoding`].
    pub fn words(self) -> Bytes {
        if self.encoding == LIBCAER_CMP { self.transcoded() } else { self.events }
    }

    /// The words of `libcaer_cmp` as EVT 3: 16-bit little-endian words, a type in the high 4 bits. 0 and 1 are the high and
    /// the low 12 bits of the time, microseconds after the message's time base (nanoseconds); 2 is the column; 3 an event
    /// in a row, polarity in bit 11; 4 the first row and polarity of what 5 has in its low 8 bits, a bit for each of the
    /// next 8 rows. (ros-event-camera/event_camera_codecs, `libcaer_cmp_types.h`.)
    fn transcoded(&self) -> Bytes {
        let in_sensor = |x: u16, y: u16| u32::from(x) < self.width && u32::from(y) < self.height;
        // What counts the rounds of EVT 3's clock looks at its 24 bits.
        let base_us = self.time_base / 1000 % (1 << 24);
        let (mut high, mut low, mut last_us) = (0, 0, 0);
        let (mut x, mut row, mut on) = (0, 0, false);
        let mut encoder = Evt3Encoder::default();
        let mut out = Vec::with_capacity(2 * self.events.len());
        let mut event = |t_us: u64, x: u16, y: u16, on: bool| {
            last_us = t_us.max(last_us);
            if in_sensor(x, y) {
                // Nothing is refused: time does not go back, a packet is shorter than any gap, and addresses have 11 bits.
                let _ = encoder.event(CdEvent { t_us: last_us, x, y, on }, &mut out);
            }
        };
        for word in self.events.as_chunks::<2>().0 {
            let word = u16::from_le_bytes(*word);
            let t_us = base_us + (high | low);
            match word >> 12 {
                0 => high = u64::from(word & 0xFFF) << 12,
                1 => low = u64::from(word & 0xFFF),
                2 => x = word & 0x7FF,
                3 => event(t_us, x, word & 0x7FF, word & 0x800 != 0),
                4 => (row, on) = (word & 0x7FF, word & 0x800 != 0),
                5 => {
                    for bit in (0..8).filter(|bit| word >> bit & 1 == 1) {
                        event(t_us, x, row + bit, on);
                    }
                    row = (row + 8).min(0x7FF);
                }
                _ => {}
            }
        }
        encoder.finish(&mut out);
        out.into()
    }
}

/// iniVation's events as the ROS driver of libcaer packs them.
const LIBCAER_CMP: &str = "libcaer_cmp";

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
