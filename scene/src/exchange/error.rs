//! What can go wrong while a rig is converted.

use std::{io, path::PathBuf};

use crate::colmap::ColmapError;

use super::Format;
use crate::rig_file::RigFileError;

/// What can go wrong while a rig is converted.
#[derive(Debug, thiserror::Error)]
pub enum ConvertError {
    /// The format needs poses.
    #[error("camera {camera} has no pose, and a {format} needs one; leave the camera out, or calibrate its pose")]
    NoPose {
        /// The camera.
        camera: String,
        /// The format.
        format: Format,
    },
    /// The format has no such lens.
    #[error(
        "camera {camera}: a {format} cannot hold its lens ({what}); calibrate with --lens {remedy}, or choose another format"
    )]
    Lens {
        /// The camera.
        camera: String,
        /// The format.
        format: Format,
        /// What the lens has.
        what: &'static str,
        /// A lens model that fits.
        remedy: &'static str,
    },
    /// A file cannot be read or written.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// `read` or `write`.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
    /// A file cannot be understood.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A COLMAP model.
    #[error(transparent)]
    Colmap(#[from] ColmapError),
    /// Our own format.
    #[error(transparent)]
    Rig(#[from] RigFileError),
}
