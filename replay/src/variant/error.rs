//! What can go wrong when a variant is made.

use std::path::PathBuf;

use erfgs_dataset::DatasetError;

use crate::simulator::SimulatorError;

/// What can go wrong when a variant is made.
#[derive(Debug, thiserror::Error)]
pub enum VariantError {
    /// The source or the new dataset cannot be read or written.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The simulator refuses a camera's frames or its parameters.
    #[error("cannot simulate the events of camera {camera}: {source}")]
    Simulator {
        /// The camera's name.
        camera: String,
        /// Why.
        source: SimulatorError,
    },
    /// The simulator's parameters are invalid.
    #[error(transparent)]
    Config(#[from] SimulatorError),
    /// An option has no meaning.
    #[error("{option} is {value}; {remedy}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: String,
        /// What to choose.
        remedy: &'static str,
    },
    /// A camera cannot become an event camera.
    #[error("camera {camera} cannot be made event-only: {why}; the training cameras with frames are {candidates}")]
    NotACandidate {
        /// The camera's name, as given.
        camera: String,
        /// Why not.
        why: &'static str,
        /// The names to choose from.
        candidates: String,
    },
    /// A camera whose frames would all go.
    #[error(
        "camera {camera} has {frames} frames, of which the variant would keep none; blur fewer frames, or let the blur be \
         shortened at the clip's ends"
    )]
    NoFrames {
        /// The camera's name.
        camera: String,
        /// Frames in the source.
        frames: usize,
    },
    /// Two files of the variant would have the same name.
    #[error("the variant would need two different files called {}; rename one of the source's frames", file.display())]
    SameFile {
        /// The file, relative to the dataset's folder.
        file: PathBuf,
    },
    /// The new dataset's folder holds something.
    #[error("{} exists and is not empty; name a new folder for the variant", path.display())]
    NotEmpty {
        /// The folder.
        path: PathBuf,
    },
}
