//! Repairing a session whose recording was cut off: what is whole stays byte for byte, and the index that was never
//! written is put behind it.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Read, Seek, SeekFrom, Write},
    path::Path,
};

use mcap::records::{Record, op};

use super::{
    error::ContainerError,
    framing::Head,
    layout::{Entry, Layout},
    parse::parse_record,
    record::{SESSION_METADATA, TOTALS_METADATA, Totals},
    session::Session,
    tail::{self, ChunkEntry, Tail},
    walk::{Item, Walk},
};

/// What a repair did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovered {
    /// The session was whole; nothing was written.
    pub was_whole: bool,
    /// Messages that were saved.
    pub messages: u64,
    /// Chunks that were saved.
    pub chunks: u64,
    /// Bytes behind the last whole record, which are lost.
    pub cut_bytes: u64,
    /// Chunks that are damaged within, which are lost; one message for each.
    pub damaged: Vec<String>,
}

/// What is whole in a file.
struct Survey {
    recovered: Recovered,
    /// Ranges of the file to keep, in order.
    keep: Vec<[u64; 2]>,
    /// What is put behind the first of them: declarations of channels, in place of the damaged chunk that may have had them.
    declarations: Vec<u8>,
    tail: Tail,
    /// The first chunk that is compressed in a way that is not read: it is left out as one that is damaged.
    unread: Option<ContainerError>,
    closed: bool,
}

/// Writes what is whole of `path` to the new file `out`, with an index. Does nothing if `path` is whole.
///
/// # Errors
/// If `path` cannot be read or is no MCAP file, if nothing of it is whole, or `out` exists or cannot be written.
pub fn recover(path: &Path, out: &Path) -> Result<Recovered, ContainerError> {
    if out.exists() {
        return Err(ContainerError::Exists { path: out.to_owned() });
    }
    let file = File::open(path).map_err(|source| open_error("open", path, source))?;
    let Survey { recovered, keep, declarations, tail, unread, closed } = survey(&file, path)?;
    if closed && recovered.damaged.is_empty() {
        return Ok(Recovered { was_whole: true, ..recovered });
    }
    worth_saving(&recovered, &tail, unread, path)?;
    let mut file = file;
    let mut read_failure = None;
    let written = erfgs_base::atomic::write_with(out, |sink| {
        for (number, &[from, to]) in keep.iter().enumerate() {
            if number == 1 {
                sink.write_all(&declarations)?;
            }
            file.seek(SeekFrom::Start(from))?;
            let copied = io::copy(&mut (&file).take(to - from), sink)?;
            if copied < to - from {
                read_failure = Some(from + copied);
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
        }
        let kept: u64 = keep.iter().map(|[from, to]| to - from).sum();
        sink.write_all(&tail.into_bytes(kept + declarations.len() as u64))
    });
    written.map_err(|source| match read_failure {
        Some(offset) => ContainerError::Read { path: path.to_owned(), offset, source },
        None => ContainerError::Write { path: out.to_owned(), offset: 0, source },
    })?;
    Ok(recovered)
}

/// Repairs `path` itself: cuts off what is not whole and appends the index, which needs next to no room. Does nothing if
/// it is whole.
///
/// # Errors
/// If the file cannot be read or written or is no MCAP file, or if it is damaged in the middle: that is left to
/// [`recover`].
pub fn recover_in_place(path: &Path) -> Result<Recovered, ContainerError> {
    let file = File::options().read(true).write(true).open(path);
    let mut file = file.map_err(|source| open_error("open", path, source))?;
    let Survey { recovered, keep, tail, closed, .. } = survey(&file, path)?;
    if !recovered.damaged.is_empty() {
        return Err(ContainerError::DamagedWithin { path: path.to_owned(), places: recovered.damaged.len() });
    }
    if closed {
        return Ok(Recovered { was_whole: true, ..recovered });
    }
    worth_saving(&recovered, &tail, None, path)?;
    let end = keep.last().map_or(0, |[_, to]| *to);
    let write_error = |source| ContainerError::Write { path: path.to_owned(), offset: end, source };
    file.set_len(end).map_err(write_error)?;
    file.seek(SeekFrom::End(0)).map_err(write_error)?;
    file.write_all(&tail.into_bytes(end)).map_err(write_error)?;
    file.sync_all().map_err(write_error)?;
    Ok(recovered)
}

/// Refuses to make a session of nothing; `unread` is what tells then why, if any chunk was compressed otherwise.
fn worth_saving(
    recovered: &Recovered,
    tail: &Tail,
    unread: Option<ContainerError>,
    path: &Path,
) -> Result<(), ContainerError> {
    let path = || path.to_owned();
    if recovered.messages == 0 && !recovered.damaged.is_empty() {
        let nothing = ContainerError::NothingWhole { path: path(), places: recovered.damaged.len() };
        return Err(unread.unwrap_or(nothing));
    }
    if recovered.messages == 0 && !tail.has_metadata(SESSION_METADATA) {
        let what = "neither the start of a session nor any message in it is whole";
        return Err(ContainerError::NotASession { path: path(), what });
    }
    Ok(())
}

fn is_totals(opcode: u8, body: &[u8]) -> bool {
    matches!(parse_record(opcode, body), Ok(Record::Metadata(metadata)) if metadata.name == TOTALS_METADATA)
}

fn open_error(what: &'static str, path: &Path, source: io::Error) -> ContainerError {
    ContainerError::Open { what, path: path.to_owned(), source }
}

/// Reads the file through and notes what is whole.
fn survey(file: &File, path: &Path) -> Result<Survey, ContainerError> {
    let survey = survey_with(file, path, Layout::default())?;
    if survey.recovered.damaged.is_empty() {
        return Ok(survey);
    }
    // A damaged chunk may be the one that declared a stream, whose messages nobody could read then. The index, if there
    // is one, declares it as well.
    match Session::read(file, path).ok().and_then(Session::declared) {
        Some(declared) => survey_with(file, path, declared),
        None => Ok(survey),
    }
}

/// Reads the file through, in which the channels of `declared` are known from the beginning.
fn survey_with(file: &File, path: &Path, declared: Layout) -> Result<Survey, ContainerError> {
    let declarations = tail::declarations(&declared);
    let mut walk = Walk::open(file, path)?;
    walk.raw = true;
    walk.layout = declared;
    let file_bytes = walk.framing.length();
    let mut survey = Survey {
        recovered: Recovered::default(),
        keep: vec![[0, 0]],
        declarations: Vec::new(),
        tail: Tail::default(),
        unread: None,
        closed: false,
    };
    let mut totals = Totals::default();
    // By how many bytes what follows moves in the copy.
    let mut shift = 0;
    let mut skipping_indexes = false;
    loop {
        match walk.step() {
            Ok(Item::Chunk(head, header)) => {
                skipping_indexes = false;
                survey.recovered.chunks += 1;
                let offset = head.offset.saturating_add_signed(shift);
                survey.tail.begin(ChunkEntry::new(offset, head.end() - head.offset, header));
            }
            Ok(Item::BadChunk(head, error)) => {
                skipping_indexes = true;
                survey.recovered.damaged.push(error.to_string());
                survey.leave_out(&head, &mut shift);
                if matches!(error, ContainerError::Compression { .. }) {
                    survey.unread.get_or_insert(error);
                }
                if survey.keep.len() == 2 {
                    shift += declarations.len() as i64;
                    survey.declarations.clone_from(&declarations);
                }
            }
            Ok(Item::Raw(message)) => {
                survey.recovered.messages += 1;
                survey.tail.count(&message);
            }
            Ok(Item::Entry(entry)) => count(&mut walk, &mut totals, entry),
            Ok(Item::Record(head)) if head.opcode == op::MESSAGE_INDEX && skipping_indexes => {
                survey.leave_out(&head, &mut shift);
            }
            Ok(Item::Record(head)) => {
                let body = walk.framing.body(&head)?;
                if !survey.recovered.damaged.is_empty() && is_totals(head.opcode, &body) {
                    // They count what is left out; the copy's are counted anew.
                    survey.leave_out(&head, &mut shift);
                    continue;
                }
                survey.tail.note(&head, &body, shift);
            }
            Ok(Item::End { at, closed }) => {
                if !closed && walk.is_closed()? {
                    // The file goes on to its proper end, so that it was not cut off here.
                    let what = "a record's length is damaged, and what follows it cannot be found".to_owned();
                    let error = ContainerError::Damaged { path: path.to_owned(), offset: at, what };
                    survey.recovered.damaged.push(error.to_string());
                }
                survey.closed = closed;
                survey.recovered.cut_bytes = if closed { 0 } else { file_bytes.saturating_sub(at) };
                // The index of the last chunk may be cut, too: it is written anew.
                let end = survey.tail.unindexed_chunk_end().map_or(at, |end| end.saturating_add_signed(-shift));
                if let Some(last) = survey.keep.last_mut() {
                    last[1] = end.max(last[0]);
                }
                break;
            }
            Err(error @ ContainerError::Read { .. }) => return Err(error),
            // A message that does not parse is copied as it is.
            Err(_) => {}
        }
    }
    for stream in &walk.layout.streams {
        totals.streams.insert(stream.description.id.clone(), stream.totals);
    }
    survey.tail.declare(&walk.layout);
    if !survey.tail.has_metadata(TOTALS_METADATA) && !totals.streams.is_empty() {
        survey.tail.totals = Some(totals.to_metadata());
    }
    Ok(survey)
}

fn count<R: Read + Seek>(walk: &mut Walk<R>, totals: &mut Totals, entry: Entry) {
    match entry {
        Entry::Packet { stream, packet } => walk.layout.streams[stream].totals.count(&packet),
        Entry::Status(status) => totals.status = Some(status),
        Entry::Incident(incident) => totals.note(incident),
        Entry::Clock { stream, fit } => drop(totals.clocks.insert(stream, fit)),
        Entry::DecoderState(_) => {}
    }
}

impl Survey {
    fn leave_out(&mut self, head: &Head, shift: &mut i64) {
        if let Some(last) = self.keep.last_mut() {
            last[1] = head.offset;
        }
        self.keep.push([head.end(), head.end()]);
        *shift -= (head.end() - head.offset) as i64;
    }
}

/// Text by name, as metadata holds it.
pub(super) type Texts = BTreeMap<String, String>;
