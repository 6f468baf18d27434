//! `event_camera_msgs/msg/EventPacket` of ROS 2: the words of an event camera in a message.
//!
//! Fields in the order of the message definition, as CDR lays them out: header (stamp, frame_id), height, width, seq,
//! time_base, encoding, is_bigendian, events. See the README of ros-event-camera/event_camera_msgs for the encodings.

use bytes::{Buf, Bytes};

use crate::source::Encoding;

/// Name of the schema.
pub(super) const SCHEMA_NAME: &str = "event_camera_msgs/msg/EventPacket";

/// One message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct EventPacket {
    pub frame_id: String,
    pub height: u32,
    pub width: u32,
    pub sequence: u64,
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
        cdr.u64()?;
        let encoding = cdr.string()?;
        cdr.take(1)?;
        let count = cdr.u32()? as usize;
        let events = cdr.take(count)?;
        Some(Self { frame_id, height, width, sequence, encoding, events })
    }

    /// The encoding, if it is one that erfgs decodes.
    pub fn known_encoding(&self) -> Option<Encoding> {
        match self.encoding.as_str() {
            "evt3" => Some(Encoding::Evt3),
            "evt2" => Some(Encoding::Evt2),
            "evt21" => Some(Encoding::Evt21),
            _ => None,
        }
    }
}

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
