//! Repairing a session whose recording was cut off, or which was damaged: what is whole stays byte for byte, and the index
//! that was never written is put behind it. [`super::survey`] finds what is whole.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use super::{
    error::ContainerError,
    layout::Entry,
    record::SESSION_METADATA,
    session::Session,
    survey::{Piece, Survey, survey},
    tail::{Tail, chunk_of},
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
    /// What is lost of the rest: chunks that are damaged within, messages that cannot be read, packets that the end of the
    /// file counts and that are not there.
    pub damaged: Vec<String>,
    /// What was damaged and is as it was before: a bit that flipped is told by the checksum.
    pub mended: Vec<String>,
}

/// Writes what is whole of `path` to the new file `out`, with an index, and reads it back. Does nothing if `path` is whole.
///
/// # Errors
/// If `path` cannot be read or is no MCAP file, if nothing of it is whole, if `out` exists or cannot be written, or does not
/// hold what was read.
pub fn recover(path: &Path, out: &Path) -> Result<Recovered, ContainerError> {
    if out.exists() {
        return Err(ContainerError::Exists { path: out.to_owned() });
    }
    let file = File::open(path).map_err(|source| open_error("open", path, source))?;
    let survey = survey(&file, path)?;
    if survey.is_whole() {
        return Ok(Recovered { was_whole: true, ..survey.recovered });
    }
    worth_saving(&survey, path)?;
    let failed = |source| ContainerError::Write { path: out.to_owned(), offset: 0, source };
    let Survey { recovered, pieces, patches, tail, .. } = survey;
    let copy = |sink: &mut io::BufWriter<&File>| copy(&file, path, (&pieces, &patches), tail, sink, out);
    erfgs_base::atomic::try_write_with(out, copy, failed)?;
    let as_much = || if recovered.damaged.is_empty() { Ok(()) } else { holds_as_much(out, path) };
    read_back(out, &recovered).and_then(|()| as_much()).inspect_err(|_| drop(std::fs::remove_file(out)))?;
    Ok(recovered)
}

/// Fails unless a reader finds every message of `path` that can be read now in the copy `out`, too: of files that were put together
/// from parts of several recordings, a damaged declaration may be all that tells whose messages these are.
fn holds_as_much(out: &Path, path: &Path) -> Result<(), ContainerError> {
    // What cannot be opened at all holds nothing.
    let Ok(mut original) = Session::open(path) else { return Ok(()) };
    let mut copy = Session::open(out)?;
    let topics = |session: &Session| -> Vec<String> {
        session.summary().streams.iter().map(|stream| stream.topic.clone()).collect()
    };
    let (topics_before, topics_after) = (topics(&original), topics(&copy));
    let mut after = copy.messages(None).filter_map(Result::ok);
    for (index, entry) in original.messages(None).filter_map(Result::ok).enumerate() {
        let same = |found: Entry| match (&entry, found) {
            (Entry::Packet { stream, packet }, Entry::Packet { stream: of, packet: found }) => {
                topics_before.get(*stream) == topics_after.get(of) && *packet == found
            }
            (entry, found) => *entry == found,
        };
        if !after.any(same) {
            let what = format!("of the messages that can be read now, number {index} cannot be read in the copy");
            return Err(ContainerError::NotAsRead { path: out.to_owned(), what });
        }
    }
    Ok(())
}

/// Writes a copy of the pieces, and the end behind it.
fn copy(
    mut file: &File,
    path: &Path,
    (pieces, patches): (&[Piece], &[(u64, u8)]),
    tail: Tail,
    sink: &mut impl Write,
    out: &Path,
) -> Result<(), ContainerError> {
    let mut written = 0;
    let failed = |source| ContainerError::Write { path: out.to_owned(), offset: 0, source };
    for piece in pieces {
        match piece {
            Piece::Keep([from, to]) => {
                let mut at = *from;
                for &(place, byte) in patches.iter().filter(|(place, _)| (*from..*to).contains(place)) {
                    copy_range(file, path, [at, place], sink, failed)?;
                    sink.write_all(&[byte]).map_err(&failed)?;
                    at = place + 1;
                }
                copy_range(file, path, [at, *to], sink, failed)?;
                written += to - from;
            }
            Piece::Bytes(bytes) => {
                sink.write_all(bytes).map_err(&failed)?;
                written += bytes.len() as u64;
            }
            Piece::Chunk { at, kept } => {
                let mut walk = Walk::open(&mut file, path)?;
                walk.go_to(*at);
                while !matches!(walk.step()?, Item::Chunk(..)) {}
                let content = walk.chunk_content();
                let records: Vec<_> = kept.iter().map(|range| content.slice(range.clone())).collect();
                let bytes = chunk_of(&records, written).map(|(bytes, _)| bytes).unwrap_or_default();
                sink.write_all(&bytes).map_err(&failed)?;
                written += bytes.len() as u64;
            }
        }
    }
    sink.write_all(&tail.into_bytes(written)).map_err(&failed)
}

fn copy_range(
    mut file: &File,
    path: &Path,
    [from, to]: [u64; 2],
    sink: &mut impl Write,
    failed: impl Fn(io::Error) -> ContainerError,
) -> Result<(), ContainerError> {
    let unread = |offset| move |source| ContainerError::Read { path: path.to_owned(), offset, source };
    file.seek(SeekFrom::Start(from)).map_err(unread(from))?;
    let copied = io::copy(&mut file.take(to - from), sink).map_err(failed)?;
    if copied < to - from {
        return Err(unread(from + copied)(io::ErrorKind::UnexpectedEof.into()));
    }
    Ok(())
}

/// Fails unless `path` is whole and holds the messages that were read.
fn read_back(path: &Path, recovered: &Recovered) -> Result<(), ContainerError> {
    let file = File::open(path).map_err(|source| open_error("open", path, source))?;
    let mut again = survey(&file, path)?;
    let wrong = |what| Err(ContainerError::NotAsRead { path: path.to_owned(), what });
    if !again.is_whole() {
        let first = again.recovered.damaged.drain(..).next().unwrap_or_else(|| "its end is missing".into());
        return wrong(first);
    }
    if again.recovered.messages != recovered.messages {
        return wrong(format!("it has {} messages of {}", again.recovered.messages, recovered.messages));
    }
    Session::open(path).map(drop)
}

/// Repairs `path` itself: cuts off what is not whole and appends the index, which needs next to no room. What it cuts off and
/// overwrites is kept beside it, as `NAME.before`, until the result was read back. Does nothing if it is whole.
///
/// # Errors
/// If the file cannot be read or written or is no MCAP file, or if something in its middle is lost: that is left to
/// [`recover`]. Then it is as it was before.
pub fn recover_in_place(path: &Path) -> Result<Recovered, ContainerError> {
    let file = File::options().read(true).write(true).open(path);
    let file = file.map_err(|source| open_error("open", path, source))?;
    let survey = survey(&file, path)?;
    if !survey.recovered.damaged.is_empty() {
        return Err(ContainerError::DamagedWithin { path: path.to_owned(), places: survey.recovered.damaged.len() });
    }
    if survey.is_whole() {
        return Ok(Recovered { was_whole: true, ..survey.recovered });
    }
    worth_saving(&survey, path)?;
    let Survey { recovered, patches, tail, end, .. } = survey;
    let before = Before::keep(&file, path, end, &patches)?;
    let write = || {
        for (place, byte) in &patches {
            put(&file, *place, &[*byte])?;
        }
        file.set_len(end)?;
        put(&file, end, &tail.into_bytes(end))?;
        file.sync_all()
    };
    let written = write().map_err(|source| ContainerError::Write { path: path.to_owned(), offset: end, source });
    match written.and_then(|()| read_back(path, &recovered)) {
        Ok(()) => before.forget(),
        Err(error) => {
            before.put_back(&file)?;
            return Err(error);
        }
    }
    Ok(recovered)
}

fn put(mut file: &File, at: u64, bytes: &[u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(at))?;
    file.write_all(bytes)
}

/// What a repair in place overwrites, in a file beside it: the end of the session from a byte on.
struct Before {
    path: PathBuf,
    from: u64,
    bytes: Vec<(u64, u8)>,
}

impl Before {
    fn keep(mut file: &File, path: &Path, from: u64, patches: &[(u64, u8)]) -> Result<Self, ContainerError> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".before");
        let kept = path.with_file_name(name);
        if kept.exists() {
            return Err(ContainerError::Exists { path: kept });
        }
        let unread = |offset| move |source| ContainerError::Read { path: path.to_owned(), offset, source };
        let mut bytes = Vec::new();
        for &(at, _) in patches {
            let mut byte = [0];
            file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut byte)).map_err(unread(at))?;
            bytes.push((at, byte[0]));
        }
        file.seek(SeekFrom::Start(from)).map_err(unread(from))?;
        let copied = erfgs_base::atomic::write_with(&kept, |sink| io::copy(&mut file, sink).map(drop));
        copied.map_err(|source| ContainerError::Write { path: kept.clone(), offset: 0, source })?;
        Ok(Self { path: kept, from, bytes })
    }

    fn forget(&self) {
        let _ = std::fs::remove_file(&self.path);
    }

    /// The session is as it was before.
    fn put_back(&self, mut file: &File) -> Result<(), ContainerError> {
        let mut put_all = || {
            for (at, byte) in &self.bytes {
                put(file, *at, &[*byte])?;
            }
            file.set_len(self.from)?;
            file.seek(SeekFrom::Start(self.from))?;
            io::copy(&mut File::open(&self.path)?, &mut file)?;
            file.sync_all()
        };
        put_all().map_err(|source| ContainerError::Write { path: self.path.clone(), offset: 0, source })?;
        self.forget();
        Ok(())
    }
}

/// Refuses to make a session of nothing.
fn worth_saving(survey: &Survey, path: &Path) -> Result<(), ContainerError> {
    let Survey { recovered, tail, unread, .. } = survey;
    let path = || path.to_owned();
    if recovered.messages == 0 && !recovered.damaged.is_empty() {
        // If a chunk was compressed otherwise, that is why.
        return Err(match unread {
            Some((offset, compression)) => {
                ContainerError::Compression { path: path(), offset: *offset, compression: compression.clone() }
            }
            None => ContainerError::NothingWhole { path: path(), places: recovered.damaged.len() },
        });
    }
    if recovered.messages == 0 && !tail.has_metadata(SESSION_METADATA) {
        let what = "neither the start of a session nor any message in it is whole";
        return Err(ContainerError::NotASession { path: path(), what });
    }
    Ok(())
}

fn open_error(what: &'static str, path: &Path, source: io::Error) -> ContainerError {
    ContainerError::Open { what, path: path.to_owned(), source }
}
