//! The records and messages within a chunk.

use bytes::{Buf, Bytes};
use mcap::records::op;

/// Takes the first record off a chunk's content: its opcode and its body.
pub(super) fn take_record(content: &mut Bytes) -> Option<(u8, Bytes)> {
    let opcode = content.try_get_u8().ok()?;
    let length = usize::try_from(content.try_get_u64_le().ok()?).ok()?;
    (length <= content.len()).then(|| (opcode, content.split_to(length)))
}

/// Where in the content of a chunk, from `from` on, the next record lies that can be a message: of a channel that is known, of a
/// time within the chunk's, and with a record or the end behind it.
pub(super) fn next_message(content: &[u8], from: usize, span: [u64; 2], known: impl Fn(u16) -> bool) -> Option<usize> {
    let is_record = |at: usize| {
        let head = content.get(at..at + 9)?;
        let length = usize::try_from(u64::from_le_bytes(*head[1..].first_chunk()?)).ok()?;
        let end = at.checked_add(9)?.checked_add(length).filter(|&end| end <= content.len())?;
        matches!(head[0], op::SCHEMA | op::CHANNEL | op::MESSAGE).then_some(end)
    };
    let is_message = |at: usize| {
        let message = content.get(at + 9..at + 9 + 14)?;
        let log_time = u64::from_le_bytes(*message[6..].first_chunk()?);
        let channel = u16::from_le_bytes(*message.first_chunk()?);
        let end = is_record(at).filter(|&end| end - at >= 9 + 22)?;
        let followed = end == content.len() || is_record(end).is_some();
        (followed && known(channel) && (span[0]..=span[1]).contains(&log_time)).then_some(())
    };
    (from..content.len()).find(|&at| content[at] == op::MESSAGE && is_message(at).is_some())
}

/// A message as it lies in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::container) struct RawMessage {
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
