//! What keeps a rig from recording.

use std::io;

use erfgs_session::source::SourceError;

use super::sink::SinkError;

/// What keeps a rig from recording.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// There is nothing to record.
    #[error("the rig has no devices: name at least one in its configuration (`erfgs devices` lists what is connected)")]
    NoDevices,
    /// Two streams of one name.
    #[error("two devices of the rig are called '{0}': each needs an id of its own")]
    DuplicateId(String),
    /// A name that no file or address could carry.
    #[error("'{0}' is no id for a device: use 1 to 64 letters, digits, '-' and '_'")]
    BadId(String),
    /// A device did not start.
    #[error("cannot start '{id}' ({model}): {source}")]
    Start {
        /// The stream.
        id: String,
        /// Its model.
        model: String,
        /// What its driver says.
        source: SourceError,
    },
    /// The session file.
    #[error(transparent)]
    Sink(#[from] SinkError),
    /// A recording runs already.
    #[error("a recording runs already, into '{0}': stop it first")]
    Busy(String),
    /// No recording runs.
    #[error("no recording runs")]
    NotRecording,
    /// The system gives no thread.
    #[error("cannot start the thread '{name}': {source}")]
    Thread {
        /// Its name.
        name: &'static str,
        /// What the system says.
        source: io::Error,
    },
}
