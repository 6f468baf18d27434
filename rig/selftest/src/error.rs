//! Why a rig could not test itself. What is wrong with its devices is no error but a verdict.

use std::{io, path::PathBuf};

use erfgs_base::FileError;
use erfgs_recorder::RecordError;
use erfgs_session::container::ContainerError;

/// A test that could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SelftestError {
    /// The rig has no devices.
    #[error("the rig names no devices: add [[evk4]], [[davis346]], [[camera]] or others (erfgs record --example)")]
    NoDevices,
    /// No folder for the recordings.
    #[error("cannot make a folder for the recordings of the test: {0}")]
    Scratch(io::Error),
    /// No folder to keep the recordings in.
    #[error(transparent)]
    Keep(FileError),
    /// A recording cannot be made.
    #[error("cannot record for the test: {0}")]
    Record(#[from] RecordError),
    /// A recording ended early.
    #[error(
        "the recording '{}' of the test ended early: {failure}. Free some space, or set TMPDIR or --keep to a folder with room",
        path.display()
    )]
    Ended {
        /// The session file.
        path: PathBuf,
        /// What went wrong.
        failure: String,
    },
    /// The user stopped the test.
    #[error("stopped before the rig was tested; no report is written")]
    Stopped,
    /// A recording cannot be read.
    #[error(transparent)]
    Session(#[from] ContainerError),
    /// The report cannot be written.
    #[error(transparent)]
    Report(FileError),
}
