//! What can go wrong on the stage.

use std::path::PathBuf;

use thiserror::Error;

use super::RigCamera;

/// Why something could not be rendered or filmed.
#[derive(Debug, Error)]
pub enum StageError {
    /// A rig without cameras.
    #[error("the rig has no cameras: ask for at least one RGB, event or test camera")]
    NoCameras,
    /// More cameras than the arc has room for.
    #[error("{count} cameras do not fit on the arc: ask for at most {most} in all")]
    TooManyCameras {
        /// Cameras asked for.
        count: usize,
        /// The most that can be had.
        most: usize,
    },
    /// An image size that cannot be rendered.
    #[error("cannot render images of {width}x{height} pixels: each side must be 1 to {most} pixels")]
    Size {
        /// Width asked for, pixels.
        width: u32,
        /// Height asked for, pixels.
        height: u32,
        /// The longest side that can be had, pixels.
        most: u32,
    },
    /// A camera that is no pinhole, or has numbers that are not finite.
    #[error("the stage renders ideal pinhole cameras with finite numbers and positive focal lengths: {why}")]
    Camera {
        /// What is wrong with it.
        why: &'static str,
    },
    /// A number outside its range.
    #[error("{what} is {value}: it must be {range}")]
    Range {
        /// Which number.
        what: &'static str,
        /// What was asked for.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// A camera that the rig does not have.
    #[error("the rig has no camera `{name}`: it has {known}")]
    UnknownCamera {
        /// The name asked for.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// The output folder is in use.
    #[error("{path} exists and is not empty: choose another folder, or remove it first", path = .path.display())]
    NotEmpty {
        /// The folder.
        path: PathBuf,
    },
    /// A file or folder could not be written.
    #[error("cannot write {path}", path = .path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl StageError {
    /// That `rig` has no camera of this name, with the names that it has.
    #[must_use]
    pub fn unknown(name: &str, rig: &[RigCamera]) -> Self {
        let known = rig.iter().map(|camera| camera.name.as_str()).collect::<Vec<_>>().join(", ");
        Self::UnknownCamera { name: name.to_owned(), known }
    }

    /// `value` if it satisfies `valid` (never true of NaN comparisons), else the error that names it.
    pub(crate) fn check(what: &'static str, value: f64, valid: bool, range: &'static str) -> Result<f64, Self> {
        if valid && value.is_finite() { Ok(value) } else { Err(Self::Range { what, value, range }) }
    }
}
