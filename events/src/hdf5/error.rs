//! What can go wrong with an HDF5 file.

use std::path::PathBuf;

use erfgs_base::FileError;

/// What can go wrong with an HDF5 file of events. Each message names the file and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Hdf5Error {
    /// This program was built without HDF5.
    #[error(
        "cannot {doing} {}: this erfgs was built without HDF5; install libhdf5-dev and build with `cargo build --release \
         --features hdf5`, or take npz, csv or raw",
        path.display()
    )]
    NotBuilt {
        /// `read` or `write`.
        doing: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// The library failed.
    #[error("cannot {doing} {}: HDF5 says: {what}", path.display())]
    Library {
        /// What was being done, and to what of the file.
        doing: String,
        /// The file.
        path: PathBuf,
        /// What the library says.
        what: String,
    },
    /// The file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file is HDF5, and its content is no events.
    #[error(
        "{} holds no events that erfgs reads: {what}; layouts are DSEC's (/events/t, x, y, p) and Metavision's (/CD/events)",
        path.display()
    )]
    Layout {
        /// The file.
        path: PathBuf,
        /// What was found or missing.
        what: String,
    },
    /// A chunk cannot be unpacked.
    #[error("chunk {chunk} of {dataset} in {}: {what}", path.display())]
    Chunk {
        /// The file.
        path: PathBuf,
        /// The dataset.
        dataset: String,
        /// Which one.
        chunk: usize,
        /// What is wrong or not supported, and what to do.
        what: String,
    },
    /// The events do not fit the layout.
    #[error("cannot write {}: event {event} {what}; write raw, npz or csv instead", path.display())]
    Events {
        /// The file.
        path: PathBuf,
        /// Which event.
        event: u64,
        /// What the layout cannot hold.
        what: String,
    },
}
