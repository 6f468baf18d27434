//! Why a recording is not written.

use std::{
    io,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use erfgs_events::EncodeError;
use erfgs_session::container::ContainerError;
use erfgs_sync::reading::ReadError;
use mcap::McapError;

/// Why a recording does not become a file of other programs.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The file system refuses.
    #[error(transparent)]
    File(#[from] FileError),
    /// A record cannot be written.
    #[error("cannot write {path}: {source}", path = path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Why.
        source: McapError,
    },
    /// The place of the folder is taken.
    #[error("{path} exists already and is not empty: give another --out, or remove it", path = path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// There is nothing to write.
    #[error("{path} has no frames and no events that a clock dates: there is nothing to write", path = path.display())]
    Nothing {
        /// The recording.
        path: PathBuf,
    },
    /// Nothing says how large a sensor is.
    #[error("nothing says how large the sensor of stream '{id}' is, and pictures of its events need it")]
    NoSize {
        /// The stream.
        id: String,
    },
    /// The stream is none of a camera, or of one whose events are not decoded.
    #[error("stream '{id}' has neither events that erfgs decodes nor frames: give another --stream")]
    NoCamera {
        /// The stream.
        id: String,
    },
    /// The rig is of other cameras.
    #[error("no camera of the rig file has the name of a stream: its cameras are {cameras}, the streams {streams}")]
    OtherRig {
        /// Names of cameras.
        cameras: String,
        /// Names of streams.
        streams: String,
    },
    /// A camera was calibrated with pictures of another size.
    #[error(
        "camera '{id}' was calibrated with {calibrated}, and its stream has {recorded} pixels: give the rig file of this resolution"
    )]
    OtherSize {
        /// The camera.
        id: String,
        /// Columns and rows of the rig file.
        calibrated: String,
        /// Columns and rows of the stream.
        recorded: String,
    },
    /// EVT 3 has no room for an event.
    #[error("the events of stream '{id}' cannot be written as EVT 3: {source}")]
    Unfit {
        /// The stream.
        id: String,
        /// The event, and why.
        source: EncodeError,
    },
}

impl From<ContainerError> for BridgeError {
    fn from(error: ContainerError) -> Self {
        Self::Read(error.into())
    }
}

impl BridgeError {
    /// A file or folder that the system does not let us write.
    pub(crate) fn writing(path: &Path) -> impl Fn(io::Error) -> Self {
        |source| FileError::when("write", path)(source).into()
    }

    /// A record that the file does not take.
    pub(crate) fn record(path: &Path) -> impl Fn(McapError) -> Self {
        |source| match source {
            McapError::Io(source) => Self::writing(path)(source),
            source => Self::Mcap { path: path.to_owned(), source },
        }
    }
}
