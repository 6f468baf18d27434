//! What should be known of the import of a session.

use std::fmt;

/// What an import of a session left out, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SessionNote {
    /// The rig file has no camera of a stream's name.
    NoCamera {
        /// The stream.
        stream: String,
    },
    /// The rig file has no pose of a stream's camera.
    NoPose {
        /// The stream.
        stream: String,
    },
    /// The session has no stream of a camera's name.
    NoStream {
        /// The camera.
        camera: String,
    },
    /// A stream's frames have no colours and those of others do.
    NoColours {
        /// The stream.
        stream: String,
    },
    /// No part of a stream of events is dated.
    NoClock {
        /// The stream.
        stream: String,
    },
    /// A stream has nothing within the window.
    Nothing {
        /// The stream.
        stream: String,
    },
    /// Frames that should be there are damaged or not in the file.
    LostFrames {
        /// The stream.
        stream: String,
        /// How many.
        frames: usize,
    },
}

impl fmt::Display for SessionNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoCamera { stream } => write!(f, "{stream}: left out, the rig file has no camera of this name"),
            Self::NoPose { stream } => write!(f, "{stream}: left out, the rig file has no pose of it"),
            Self::NoStream { camera } => write!(f, "{camera}: the session has no stream of this camera"),
            Self::NoColours { stream } => {
                write!(f, "{stream}: left out, it sees no colours and others do (--grey takes it)")
            }
            Self::NoClock { stream } => write!(f, "{stream}: left out, its clock is not fitted to the session's"),
            Self::Nothing { stream } => write!(f, "{stream}: left out, it recorded nothing within the window"),
            Self::LostFrames { stream, frames } => {
                write!(f, "{stream}: {frames} frames are damaged or missing in the file")
            }
        }
    }
}
