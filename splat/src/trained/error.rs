//! Why a run could not be opened.

use std::{io, path::PathBuf};

use crate::model::ModelError;

/// Why a run could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum TrainedError {
    /// Its checkpoint could not be read.
    #[error(
        "could not read checkpoint '{path}': {source}; check that this is the folder of a run, as `erfgs train --out` wrote it"
    )]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Its checkpoint is damaged or of another kind.
    #[error("'{path}' is not a whole checkpoint: {reason}; move it away to train anew")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Its checkpoint is whole, and holds a number that no training leaves behind.
    #[error(
        "checkpoint '{path}' cannot be used: number {index} of its '{vector}' is {value}; take an earlier copy of it, or move it away \
         to train anew"
    )]
    Implausible {
        /// The file.
        path: PathBuf,
        /// Which vector.
        vector: String,
        /// Which of its numbers, from 0.
        index: usize,
        /// What it is.
        value: f32,
    },
    /// An earlier version trained it, which noted no cameras.
    #[error(
        "run '{run}' was trained by an earlier version and does not hold its cameras; give its dataset, or renew the run by resuming \
         its training: erfgs train DATASET --out '{run}' --resume"
    )]
    NoRecord {
        /// The run.
        run: PathBuf,
    },
    /// It does not fit the device.
    #[error(transparent)]
    Model(#[from] ModelError),
}
