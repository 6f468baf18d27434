//! The synchronisation of a session: the one in the file beside it if there is one and it fits, otherwise one fitted now.

use std::{
    collections::BTreeSet,
    fmt,
    io::{Read, Seek},
    path::{Path, PathBuf},
};

use erfgs_session::container::{ContainerError, Session, Summary};

use super::{
    collect::{SyncOptions, synchronise},
    report::{SyncFileError, Synchronisation},
};

/// Why a session has no synchronisation.
#[derive(Debug, thiserror::Error)]
pub enum SyncError {
    /// The file beside it cannot be used.
    #[error(transparent)]
    File(#[from] SyncFileError),
    /// The session cannot be read.
    #[error(transparent)]
    Session(#[from] ContainerError),
}

/// What should be known of the file beside a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SyncNote {
    /// It is of another session, and is not used.
    Misfit {
        /// The file.
        path: PathBuf,
        /// What does not fit.
        what: String,
    },
}

impl fmt::Display for SyncNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Misfit { path, what } => {
                write!(f, "{} is not used, as {what}; `erfgs sync` writes it anew", path.display())
            }
        }
    }
}

/// The synchronisation in the file beside a recording; `None` if there is no file, or it is of another recording, which
/// `note` is told.
///
/// # Errors
/// If the file cannot be read, or is of another kind or version.
pub fn kept(
    recording: &Path,
    summary: &Summary,
    note: &mut dyn FnMut(SyncNote),
) -> Result<Option<Synchronisation>, SyncFileError> {
    let path = Synchronisation::file_beside(recording);
    if !path.is_file() {
        return Ok(None);
    }
    let found = Synchronisation::load(&path)?;
    if let Some(what) = misfit(&found, summary) {
        note(SyncNote::Misfit { path, what });
        return Ok(None);
    }
    Ok(Some(found))
}

/// The synchronisation of a session: as [`kept`] beside it, or fitted now without looking for a lamp. `progress` is called
/// with the bytes of payload read so far and those of all packets.
///
/// # Errors
/// If the file beside the session, or the session, cannot be read.
pub fn of_session<R: Read + Seek>(
    session: &mut Session<R>,
    note: &mut dyn FnMut(SyncNote),
    mut progress: impl FnMut(u64, u64),
) -> Result<Synchronisation, SyncError> {
    if let Some(kept) = kept(session.path(), session.summary(), note)? {
        return Ok(kept);
    }
    let total = session.summary().streams.iter().map(|stream| stream.totals.bytes).sum();
    Ok(synchronise(session, SyncOptions::default(), |bytes| progress(bytes, total))?)
}

/// Why a synchronisation is not of these streams, if it is not. Files may be renamed, so that names tell nothing.
fn misfit(sync: &Synchronisation, summary: &Summary) -> Option<String> {
    let of_file: BTreeSet<&str> = sync.streams.iter().map(|stream| stream.id.as_str()).collect();
    let recorded: BTreeSet<&str> = summary.streams.iter().map(|stream| stream.description.id.as_str()).collect();
    if of_file != recorded {
        let list = |names: BTreeSet<&str>| names.into_iter().collect::<Vec<_>>().join(", ");
        return Some(format!("it has the streams {}, and the session {}", list(of_file), list(recorded)));
    }
    sync.streams.iter().find_map(|sync| {
        let (_, stream) = summary.stream(&sync.id)?;
        let (frames, packets) = (sync.exposures.as_ref()?.sequence.len() as u64, stream.totals.packets);
        // Event files are not counted.
        (summary.is_session && frames > packets)
            .then(|| format!("it has {frames} frames of {}, of which the session has {packets}", sync.id))
    })
}
