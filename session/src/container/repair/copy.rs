//! A copy of what is whole.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom, Write},
    path::Path,
};

use super::{
    Recovered, open_error, read_back,
    survey::{Piece, Survey, survey},
    tail::{Tail, chunk_of},
    worth_saving,
};
use crate::container::{
    ContainerError, Entry, Session,
    read::{Item, Walk},
    whole::write_whole,
};

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
    let Survey { recovered, pieces, patches, tail, .. } = survey;
    let copy = |sink: &mut io::BufWriter<&File>| copy(&file, path, (&pieces, &patches), tail, sink, out);
    write_whole(out, copy)?;
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
