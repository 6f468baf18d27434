//! The records and messages within a chunk.

use bytes::{Buf, Bytes};

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
