//! What can go wrong with a file of another program.

use std::path::PathBuf;

use erfgs_base::{FileError, npy::NpyError};

use super::Format;
use crate::{colmap::ColmapError, rig_file::RigFileError};

/// What can go wrong with a file of another program, read or written.
#[derive(Debug, thiserror::Error)]
pub enum ExchangeError {
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
    /// There is nothing to write.
    #[error("the rig has no camera, so that there is nothing to write")]
    Empty,
    /// Two cameras have one name.
    #[error("two cameras are called {name}, and a {format} tells them apart by their names; rename one of them")]
    SameName {
        /// The name.
        name: String,
        /// The format.
        format: Format,
    },
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file cannot be understood.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// Lengths that are hardly metres, in a file that does not say what they are.
    #[error(
        "{}: {seen} if its lengths are metres, and it does not say; say what they are: {likely}, or --units m if they are (erfgs \
         calibrate convert {} --to rig --units ...)",
        path.display(),
        path.display()
    )]
    Unit {
        /// The file.
        path: PathBuf,
        /// The distances that were seen.
        seen: String,
        /// The units that they may be in.
        likely: String,
    },
    /// What a file says of one camera cannot be used.
    #[error("camera {camera}: {}: {what}", path.display())]
    Camera {
        /// The camera's name, or its image.
        camera: String,
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        what: String,
    },
    /// A NumPy array cannot be used.
    #[error("{} {source}", path.display())]
    Npy {
        /// The file.
        path: PathBuf,
        /// Why.
        source: NpyError,
    },
    /// A COLMAP model.
    #[error(transparent)]
    Colmap(#[from] ColmapError),
    /// Our own format.
    #[error(transparent)]
    Rig(#[from] RigFileError),
}
