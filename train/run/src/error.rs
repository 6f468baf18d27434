//! What can go wrong with a run folder.

use std::path::PathBuf;

use erfgs_base::FileError;

/// What can go wrong when a run folder is read or written.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The folder does not exist or holds no run.
    #[error(
        "'{}' is not a run folder: it has no run.json; give a folder that `erfgs train --out` wrote",
        folder.display()
    )]
    NotARun {
        /// The folder.
        folder: PathBuf,
    },
    /// A file that the run should have is not there.
    #[error("'{}' is missing; {hint}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// What to do next.
        hint: &'static str,
    },
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file does not hold what it should.
    #[error("'{}' is not a valid {what}: {message}; {remedy}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
        /// What is wrong with it.
        message: String,
        /// What to do next.
        remedy: &'static str,
    },
    /// The folder was written by a newer erfgs.
    #[error(
        "'{}' has format version {found}, but this erfgs reads versions up to {known}; use the erfgs that wrote it or a newer one",
        path.display()
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u32,
        /// The newest version that is understood.
        known: u32,
    },
    /// A camera's name cannot be part of a path.
    #[error(
        "camera name '{name}' cannot be a folder name: use letters, digits, '-', '_' and '.' only, and rename the camera in dataset.json"
    )]
    CameraName {
        /// The name.
        name: String,
    },
}
