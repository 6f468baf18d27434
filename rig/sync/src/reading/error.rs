//! Why a recording is not read.

use std::path::PathBuf;

use erfgs_session::{container::ContainerError, export::ExportError};

use crate::SyncError;

/// Why events, frames or slices of a recording cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] ContainerError),
    /// It has no clocks.
    #[error(transparent)]
    Sync(#[from] SyncError),
    /// Nothing tells how many bits of its frames' samples count.
    #[error(transparent)]
    Depth(#[from] ExportError),
    /// The stream holds something else.
    #[error("stream '{id}' of {path} has no {what}: {why}", path = path.display())]
    Lacks {
        /// The recording.
        path: PathBuf,
        /// The stream.
        id: String,
        /// What was asked for.
        what: &'static str,
        /// Why there is none.
        why: &'static str,
    },
    /// A slice would hold nothing.
    #[error("slices of {length_ns} ns hold nothing: give a length above 0")]
    SliceLength {
        /// What was asked for.
        length_ns: i64,
    },
}
