//! What is whole in a file that may be cut off or damaged.

use std::{collections::BTreeMap, fs::File, ops::Range, path::Path};

use mcap::records::{Record, op};

use super::{
    Recovered,
    tail::{self, ChunkEntry, Tail, chunk_of},
};
use crate::container::{
    ContainerError,
    read::{Declarations, Item, Layout, Walk, parse_record},
    record::{SESSION_METADATA, TOTALS_METADATA, Totals},
};

/// A part of a copy.
pub(super) enum Piece {
    /// A range of the file.
    Keep([u64; 2]),
    Bytes(Vec<u8>),
    /// The chunk that lies at a byte of the file, with some of its records alone.
    Chunk {
        at: u64,
        kept: Vec<Range<usize>>,
    },
}

/// What is whole in a file.
#[derive(Default)]
pub(super) struct Survey {
    pub recovered: Recovered,
    /// What the copy consists of, in order.
    pub pieces: Vec<Piece>,
    /// Bytes of the file that were others before it was damaged.
    pub patches: Vec<(u64, u8)>,
    pub tail: Tail,
    /// Where the first chunk lies that is compressed in a way that is not read, and in which: it is left out as one that is
    /// damaged.
    pub unread: Option<(u64, String)>,
    /// Where the last whole record ends.
    pub end: u64,
    /// Where the data ends.
    data_end: u64,
    /// Whether the file was closed as it should be.
    pub closed: bool,
    /// From where on the file is kept, after the last piece.
    from: u64,
    /// By how many bytes what follows moves in the copy.
    shift: i64,
    /// Declarations for the copy, before its first chunk.
    declarations: Option<Vec<u8>>,
}

impl Survey {
    /// Whether there is nothing to repair.
    pub fn is_whole(&self) -> bool {
        self.closed && self.recovered.damaged.is_empty() && self.recovered.mended.is_empty()
    }

    fn leave_out(&mut self, [from, to]: [u64; 2]) {
        self.pieces.push(Piece::Keep([self.from, from]));
        self.from = to;
        self.shift -= (to - from) as i64;
    }

    /// Before `at` there is something else in the copy.
    fn put(&mut self, at: u64, piece: Piece, length: u64) {
        self.leave_out([at, at]);
        self.pieces.push(piece);
        self.shift += length as i64;
    }

    /// Before the first chunk or message, at `at`, everything is declared.
    fn declare_before(&mut self, at: u64) {
        if let Some(bytes) = self.declarations.take() {
            let length = bytes.len() as u64;
            self.put(at, Piece::Bytes(bytes), length);
        }
    }

    fn damaged(&mut self, error: &ContainerError) {
        if let ContainerError::Compression { offset, compression, .. } = error {
            self.unread.get_or_insert((*offset, compression.clone()));
        }
        self.recovered.damaged.push(error.to_string());
    }
}

/// Reads the file through and notes what is whole.
pub(super) fn survey(file: &File, path: &Path) -> Result<Survey, ContainerError> {
    let survey = survey_with(file, path, None)?;
    if survey.recovered.damaged.is_empty() {
        return Ok(survey);
    }
    // What is damaged may have declared a stream, whose messages nobody could read then. The index, if there is one, declares
    // it as well.
    let declared = match survey.closed {
        true => Walk::open(file, path)?.framing.index_behind(survey.data_end)?.declared,
        false => Declarations::default(),
    };
    if declared.channels.is_empty() { Ok(survey) } else { survey_with(file, path, Some(&declared)) }
}

fn is_totals(opcode: u8, body: &[u8]) -> Option<BTreeMap<String, String>> {
    match parse_record(opcode, body) {
        Ok(Record::Metadata(metadata)) if metadata.name == TOTALS_METADATA => Some(metadata.metadata),
        _ => None,
    }
}

/// Reads the file through, in which what is `declared` is known from the beginning.
fn survey_with(file: &File, path: &Path, declared: Option<&Declarations>) -> Result<Survey, ContainerError> {
    let mut walk = Walk::open(file, path)?;
    walk.raw = true;
    let mut survey = Survey::default();
    if let Some(declared) = declared {
        walk.layout = Layout::of(declared);
        survey.declarations = Some(tail::declarations(&walk.layout.declared));
    }
    let file_bytes = walk.framing.length();
    let mut totals = Totals::default();
    // The chunk that is read: where it lies, and whether anything in it is damaged.
    let mut chunk: Option<([u64; 2], bool)> = None;
    let mut skipping_indexes = false;
    loop {
        match walk.step() {
            Ok(Item::Chunk(head, header)) => {
                survey.declare_before(head.offset);
                skipping_indexes = false;
                survey.recovered.chunks += 1;
                let offset = head.offset.saturating_add_signed(survey.shift);
                survey.tail.begin(ChunkEntry::new(offset, head.end() - head.offset, header));
                chunk = Some(([head.offset, head.end()], false));
            }
            Ok(Item::ChunkEnd(kept)) => {
                let Some((place, true)) = chunk.take() else { continue };
                skipping_indexes = true;
                survey.leave_out(place);
                let content = walk.chunk_content();
                let records: Vec<_> = kept.iter().map(|range| content.slice(range.clone())).collect();
                let offset = place[1].saturating_add_signed(survey.shift);
                let anew = chunk_of(&records, offset);
                if let Some((bytes, _)) = &anew {
                    survey.pieces.push(Piece::Chunk { at: place[0], kept });
                    survey.shift += bytes.len() as i64;
                } else {
                    survey.recovered.chunks -= 1;
                }
                survey.tail.replace_last(anew.map(|(_, entry)| entry));
            }
            Ok(Item::BadChunk(place, error)) => {
                survey.declare_before(place[0]);
                skipping_indexes = true;
                survey.damaged(&error);
                survey.leave_out(place);
            }
            Ok(Item::Mended(error, patches)) => {
                survey.recovered.mended.push(error.to_string());
                survey.patches.extend(patches);
            }
            Ok(Item::Raw(message)) => {
                if message.offset.is_none() {
                    survey.declare_before(walk.last_record()[0]);
                }
                survey.recovered.messages += 1;
                survey.tail.count(&message);
            }
            Ok(Item::Entry(entry)) => walk.layout.count(entry, &mut totals),
            Ok(Item::Record(head)) if head.opcode == op::MESSAGE_INDEX && skipping_indexes => {
                survey.leave_out([head.offset, head.end()]);
            }
            Ok(Item::Record(head)) => {
                let body = walk.framing.body(&head)?;
                if let Some(texts) = is_totals(head.opcode, &body) {
                    let stated = Totals::from_metadata(&texts).ok();
                    if survey.recovered.damaged.is_empty() {
                        survey.recovered.damaged = walk.lacking(true, stated.as_ref(), None);
                    }
                    if !survey.recovered.damaged.is_empty() {
                        // They count what is left out; the copy's are counted anew.
                        survey.leave_out([head.offset, head.end()]);
                        continue;
                    }
                }
                survey.tail.note(&head, &body, survey.shift);
            }
            Ok(Item::End { at, closed }) => {
                if !closed && walk.is_closed()? {
                    // The file goes on to its proper end, so that it was not cut off here.
                    let what = "a record's length is damaged, and what follows it cannot be found".to_owned();
                    survey.damaged(&ContainerError::Damaged { path: path.to_owned(), offset: at, what });
                }
                (survey.closed, survey.data_end) = (closed, at);
                survey.recovered.cut_bytes = if closed { 0 } else { file_bytes.saturating_sub(at) };
                // The index of the last chunk may be cut, too: it is written anew.
                let end = survey.tail.unindexed_chunk_end();
                survey.end = end.map_or(at, |end| end.saturating_add_signed(-survey.shift)).max(survey.from);
                survey.pieces.push(Piece::Keep([survey.from, survey.end]));
                break;
            }
            Err(error @ ContainerError::Read { .. }) => return Err(error),
            Err(error) => {
                survey.damaged(&error);
                match &mut chunk {
                    Some((_, broken)) => *broken = true,
                    None => survey.leave_out(walk.last_record()),
                }
            }
        }
    }
    if survey.closed && !survey.tail.has_metadata(SESSION_METADATA) && survey.recovered.damaged.is_empty() {
        let counts = walk.framing.index_behind(survey.data_end)?.counts;
        survey.recovered.damaged = walk.lacking(false, None, counts.as_ref());
    }
    for stream in &walk.layout.streams {
        totals.streams.insert(stream.description.id.clone(), stream.totals);
    }
    survey.tail.declared = walk.layout.declared.clone();
    if !survey.tail.has_metadata(TOTALS_METADATA) && !totals.streams.is_empty() {
        survey.tail.totals = Some(totals.to_metadata());
    }
    Ok(survey)
}
