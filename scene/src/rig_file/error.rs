//! What can go wrong with a rig file.

use std::path::PathBuf;

use erfgs_base::FileError;

/// What can go wrong with a rig file.
#[derive(Debug, thiserror::Error)]
pub enum RigFileError {
    /// It cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// It cannot be understood.
    #[error("{} is no usable rig file: {what}; make one with `erfgs calibrate`", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// It was written by a newer program.
    #[error("{} is of version {version}, and this program knows versions up to {known}; update erfgs", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its version.
        version: u32,
        /// The newest version that is known.
        known: u32,
    },
}
