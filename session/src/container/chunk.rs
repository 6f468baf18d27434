//! Chunks, and the records and messages within.

use bytes::{Buf, Bytes};

/// What a chunk's record says of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ChunkHeader {
    /// Log time of its earliest message; 0 if it has none.
    pub start: u64,
    /// Log time of its latest message; 0 if it has none.
    pub end: u64,
    /// CRC-32 of its records; 0 if there is none.
    pub crc: u32,
    /// How they are compressed; empty if they are not.
    pub compression: String,
    /// Length of its records when they are unpacked.
    pub unpacked: u64,
    /// Length of its records, as they lie in the file.
    pub packed: u64,
}

impl ChunkHeader {
    /// Takes the header off a chunk's body; the records follow in `body` then.
    pub fn take(body: &mut Bytes) -> Option<Self> {
        let start = body.try_get_u64_le().ok()?;
        let end = body.try_get_u64_le().ok()?;
        let unpacked = body.try_get_u64_le().ok()?;
        let crc = body.try_get_u32_le().ok()?;
        let name = body.try_get_u32_le().ok()? as usize;
        if name > body.len() {
            return None;
        }
        let compression = String::from_utf8(body.split_to(name).to_vec()).ok()?;
        let packed = body.try_get_u64_le().ok()?;
        Some(Self { start, end, crc, compression, unpacked, packed })
    }
}

/// Takes the first record off a chunk's content: its opcode and its body.
pub(super) fn take_record(content: &mut Bytes) -> Option<(u8, Bytes)> {
    let opcode = content.try_get_u8().ok()?;
    let length = usize::try_from(content.try_get_u64_le().ok()?).ok()?;
    (length <= content.len()).then(|| (opcode, content.split_to(length)))
}

/// A message as it lies in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct RawMessage {
    /// Where its record starts in the chunk's content; `None` if it lies outside the chunks, as some programs write it.
    pub offset: Option<u64>,
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
    pub data: Bytes,
}

impl RawMessage {
    /// From the body of a message record that starts at `offset` of a chunk's content.
    pub fn parse(mut body: Bytes, offset: Option<usize>) -> Option<Self> {
        Some(Self {
            offset: offset.map(|offset| offset as u64),
            channel: body.try_get_u16_le().ok()?,
            sequence: body.try_get_u32_le().ok()?,
            log_time: body.try_get_u64_le().ok()?,
            publish_time: body.try_get_u64_le().ok()?,
            data: body,
        })
    }
}
