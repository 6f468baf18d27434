//! Where the writer thread puts what was recorded: a session file, or what a test puts in its place.

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use erfgs_session::source::{Description, Incident, Packet};
use serde::{Deserialize, Serialize};

use super::status::{Level, Status};

/// What a session is told about itself before its streams.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SessionInfo {
    /// Name of the rig.
    pub rig: String,
    /// Whether a recording is played, and no camera is there.
    pub replay: bool,
    /// The configuration that the rig was opened with, as TOML.
    pub configuration: String,
    /// The program and its version.
    pub program: String,
    /// The machine: kernel, name.
    pub machine: BTreeMap<String, String>,
    /// What the checks before the recording warned of, one line each.
    pub warnings: Vec<String>,
    /// Host time of the session's zero, where it lies before the file was opened.
    pub begin_host_ns: Option<i64>,
}

/// An open session. One thread writes; everything given to it since the last [`SessionSink::flush`] may be lost when
/// the process is killed, nothing older.
pub trait SessionSink: Send {
    /// Writes one packet of stream `stream`, counted from 0 in the order of the descriptions.
    ///
    /// # Errors
    /// If the disk does not take it. Nothing is written after the first error.
    fn packet(&mut self, stream: usize, packet: &Packet) -> Result<(), SinkError>;

    /// Notes what happened to a stream, or to the recorder (`None`).
    ///
    /// # Errors
    /// As [`SessionSink::packet`].
    fn incident(&mut self, stream: Option<usize>, host_ns: i64, incident: &Incident) -> Result<(), SinkError>;

    /// Notes the state of the recorder: drops by stage, queues, readings of the devices.
    ///
    /// # Errors
    /// As [`SessionSink::packet`].
    fn status(&mut self, status: &Status) -> Result<(), SinkError>;

    /// Hands everything so far to the operating system, in a form that can be read without what follows.
    ///
    /// # Errors
    /// As [`SessionSink::packet`].
    fn flush(&mut self) -> Result<(), SinkError>;

    /// Bytes that the session has by now.
    fn bytes_written(&self) -> u64;

    /// Files that the session is in.
    fn files(&self) -> u32 {
        1
    }

    /// What the user should know of the files since this was called last.
    fn news(&mut self) -> Vec<(Level, String)> {
        Vec::new()
    }

    /// Completes the file: index, totals. Gives the length of the session in bytes. After an error this is not called.
    ///
    /// # Errors
    /// As [`SessionSink::packet`].
    fn finish(self: Box<Self>) -> Result<u64, SinkError>;
}

/// Opens sessions.
pub trait OpenSession: Send + Sync {
    /// Creates the session file `path`, which must not exist.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    fn open(&self, path: &Path, info: &SessionInfo, streams: &[Description])
    -> Result<Box<dyn SessionSink>, SinkError>;
}

/// Why a session cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    /// No random numbers to tell the session from others.
    #[error(
        "the system gives no random numbers, by which the files of one session are told from those of another: {0}"
    )]
    Random(getrandom::Error),
    /// The file exists; recordings are never overwritten.
    #[error("'{}' exists already, and recordings are never overwritten: choose another name or move it away", .0.display())]
    Exists(PathBuf),
    /// Nothing of it could be written, and nothing is left of it.
    #[error(transparent)]
    NotBegun(FileError),
    /// No space left.
    #[error(
        "the disk of '{}' is full. What was recorded until then can be read (`erfgs recover` completes the file); \
         free some space or record to another disk", .0.display()
    )]
    Full(PathBuf),
    /// Another error of the disk.
    #[error("cannot write the session '{}': {source}. What was recorded until then can be read (`erfgs recover`)", path.display())]
    Io {
        /// The session file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The container refused.
    #[error("cannot write the session '{}': {message}", path.display())]
    Container {
        /// The session file.
        path: PathBuf,
        /// What it says.
        message: String,
    },
}

impl SinkError {
    /// Sorts an error of the system.
    #[must_use]
    pub fn io(path: &Path, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
                Self::Full(path.to_path_buf())
            }
            io::ErrorKind::AlreadyExists => Self::Exists(path.to_path_buf()),
            _ => Self::Io { path: path.to_path_buf(), source },
        }
    }
}
