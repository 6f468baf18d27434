//! Why files do not become a session.

use std::path::PathBuf;

use erfgs_base::FileError;
use erfgs_scene::{image::ImageError, video::VideoError};
use erfgs_session::container::ContainerError;

/// Why the files of a plan do not become a session.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// Something in the plan cannot be.
    #[error("{}: {what}", path.display())]
    Plan {
        /// The plan.
        path: PathBuf,
        /// What, and what to do.
        what: String,
    },
    /// Something in a file cannot be.
    #[error("stream '{id}': {}: {what}", path.display())]
    File {
        /// The stream.
        id: String,
        /// The file.
        path: PathBuf,
        /// What, and what to do.
        what: String,
    },
    /// Frames and pulses do not belong together.
    #[error(
        "stream '{id}' has {frames} frames, and '{events}' saw {pulses} pulses{from}: {}",
        if frames > pulses {
            "frames without a pulse have no time; check the wire, or give fps or times"
        } else {
            "say with first_pulse which of them, from 0, is that of the first frame"
        }
    )]
    Count {
        /// The frames' stream.
        id: String,
        /// How many.
        frames: u64,
        /// The event camera.
        events: String,
        /// How many pulses there are for them.
        pulses: u64,
        /// From which one on, in words.
        from: String,
    },
    /// Streams lie too far apart for one recording.
    #[error(
        "'{first}' begins {seconds:.0} s before '{last}': they are of one session only if all times are session time, in which the \
         stream with starts_s = 0 begins at 0; times since 1970 need starts_s since 1970, too"
    )]
    Apart {
        /// The stream that begins first.
        first: String,
        /// The one that begins last.
        last: String,
        /// By how much.
        seconds: f64,
    },
    /// A picture cannot be read.
    #[error("stream '{id}': {source}")]
    Image {
        /// The stream.
        id: String,
        /// Why.
        source: ImageError,
    },
    /// A video cannot be read.
    #[error("stream '{id}': {source}")]
    Video {
        /// The stream.
        id: String,
        /// Why.
        source: VideoError,
    },
    /// An event file cannot be read, or the session not be written.
    #[error(transparent)]
    Session(Box<ContainerError>),
    /// The file system refuses.
    #[error(transparent)]
    Io(#[from] FileError),
}

impl From<ContainerError> for PlanError {
    fn from(error: ContainerError) -> Self {
        Self::Session(Box::new(error))
    }
}
