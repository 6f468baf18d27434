//! Repairing a session whose recording was cut off, or which was damaged: what is whole stays byte for byte, and the index
//! that was never written is put behind it. [`survey`] finds what is whole.

mod copy;
mod in_place;
mod survey;
mod tail;

use std::{fs::File, io, path::Path};

pub use self::{copy::recover, in_place::recover_in_place};

use self::survey::{Survey, survey};
use crate::container::{ContainerError, Session, record::SESSION_METADATA};

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
