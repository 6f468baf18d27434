//! The messages of a session, in the order of the file.

use std::io::{Read, Seek};

use super::{parts::Parts, walk::Item};
use crate::{
    container::{ContainerError, Entry},
    source::LATE_NS,
};

/// The messages of a session. After an error about a chunk or a message it goes on behind it; after an error of reading
/// it is over.
pub struct Messages<'a, R> {
    pub(super) parts: &'a mut Parts<R>,
    pub(super) range: Range,
}

impl<R: Read + Seek> Iterator for Messages<'_, R> {
    type Item = Result<Entry, ContainerError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.range.next(self.parts)
    }
}

/// The messages of a session, which it keeps: see [`Session::into_messages`](super::Session::into_messages).
pub struct IntoMessages<R> {
    pub(super) parts: Parts<R>,
    pub(super) range: Range,
}

impl<R: Read + Seek> Iterator for IntoMessages<R> {
    type Item = Result<Entry, ContainerError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.range.next(&mut self.parts)
    }
}

/// Which messages are handed out.
pub(super) struct Range {
    pub from_ns: i64,
    pub to_ns: i64,
    /// Whether it is over with the file.
    pub in_one_file: bool,
    /// Why nothing can be read.
    pub failed: Option<ContainerError>,
    pub over: bool,
}

impl Range {
    fn next<R: Read + Seek>(&mut self, parts: &mut Parts<R>) -> Option<Result<Entry, ContainerError>> {
        if let Some(error) = self.failed.take() {
            self.over = true;
            return Some(Err(error));
        }
        while !self.over {
            match parts.walk.step() {
                Ok(Item::Entry(Entry::Packet { stream, packet })) => {
                    // Packets lie out of the order of their times by less than this.
                    if packet.host_ns > self.to_ns.saturating_add(LATE_NS) {
                        self.over = true;
                    } else if (self.from_ns..=self.to_ns).contains(&packet.host_ns) {
                        return Some(of_session(parts, stream).map(|stream| Entry::Packet { stream, packet }));
                    }
                }
                Ok(Item::Entry(entry))
                    if host_ns(&entry).is_none_or(|time| (self.from_ns..=self.to_ns).contains(&time)) =>
                {
                    return Some(Ok(entry));
                }
                Ok(Item::End { .. }) => match if self.in_one_file { Ok(false) } else { parts.go_on() } {
                    Ok(more) => self.over = !more,
                    Err(error) => {
                        self.over = true;
                        return Some(Err(error));
                    }
                },
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

/// The stream of the session that is this one of the file. A packet of one that the index does not know would have no description.
fn of_session<R: Read + Seek>(parts: &Parts<R>, stream: usize) -> Result<usize, ContainerError> {
    parts.file().streams.get(stream).copied().ok_or_else(|| {
        let what = "the index at the end of the file does not know this packet's stream".to_owned();
        let (path, offset) = (parts.walk.framing.path().to_owned(), parts.walk.chunk_offset());
        ContainerError::Damaged { path, offset, what }
    })
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
