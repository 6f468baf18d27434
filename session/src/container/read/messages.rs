//! The messages of a session, in the order of the file.

use std::io::{Read, Seek};

use super::walk::{Item, Walk};
use crate::{
    container::{ContainerError, Entry},
    source::LATE_NS,
};

/// The messages of a session. After an error about a chunk or a message it goes on behind it; after an error of reading
/// it is over.
pub struct Messages<'a, R> {
    pub(super) walk: &'a mut Walk<R>,
    pub(super) range: Range,
}

impl<R: Read + Seek> Iterator for Messages<'_, R> {
    type Item = Result<Entry, ContainerError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.range.next(self.walk)
    }
}

/// The messages of a session, which it keeps: see [`Session::into_messages`](super::Session::into_messages).
pub struct IntoMessages<R> {
    pub(super) walk: Walk<R>,
    pub(super) range: Range,
}

impl<R: Read + Seek> Iterator for IntoMessages<R> {
    type Item = Result<Entry, ContainerError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.range.next(&mut self.walk)
    }
}

/// Which messages are handed out.
pub(super) struct Range {
    /// How many streams the summary has: a packet of another one would have no description.
    pub streams: usize,
    pub from_ns: i64,
    pub to_ns: i64,
    pub over: bool,
}

impl Range {
    fn next<R: Read + Seek>(&mut self, walk: &mut Walk<R>) -> Option<Result<Entry, ContainerError>> {
        while !self.over {
            match walk.step() {
                Ok(Item::Entry(Entry::Packet { stream, .. })) if stream >= self.streams => {
                    let what = "the index at the end of the file does not know this packet's stream".to_owned();
                    let (path, offset) = (walk.framing.path().to_owned(), walk.chunk_offset());
                    return Some(Err(ContainerError::Damaged { path, offset, what }));
                }
                // Packets lie out of the order of their times by less than this.
                Ok(Item::Entry(Entry::Packet { packet, .. }))
                    if packet.host_ns > self.to_ns.saturating_add(LATE_NS) =>
                {
                    self.over = true;
                }
                Ok(Item::Entry(entry))
                    if host_ns(&entry).is_none_or(|time| (self.from_ns..=self.to_ns).contains(&time)) =>
                {
                    return Some(Ok(entry));
                }
                Ok(Item::End { .. }) => self.over = true,
                Ok(Item::BadChunk(_, error) | Item::Mended(error, _)) => return Some(Err(error)),
                Ok(_) => {}
                Err(error) => {
                    self.over = matches!(error, ContainerError::Read { .. });
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

fn host_ns(entry: &Entry) -> Option<i64> {
    match entry {
        Entry::Packet { packet, .. } => Some(packet.host_ns),
        Entry::DecoderState(state) => Some(state.host_ns),
        Entry::Status(status) => Some(status.host_ns),
        Entry::Incident(incident) => Some(incident.host_ns),
        Entry::Clock { .. } => None,
    }
}
