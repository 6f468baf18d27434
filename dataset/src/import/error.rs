//! What can go wrong with an import.

use std::path::PathBuf;

use crate::DatasetError;
use erfgs_base::FileError;
use erfgs_events::npz::NpzError;
use erfgs_scene::{colmap::ColmapError, exchange::ExchangeError, image::ImageError, video::VideoError};
use erfgs_session::container::ContainerError;

/// What can go wrong with an import. Each message names the file and, where there is one, the camera.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// An option makes no sense for this recording.
    #[error("{0}")]
    Options(String),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The source lacks what its layout is recognised by.
    #[error("{} is missing: {remedy}", path.display())]
    Missing {
        /// The file or folder.
        path: PathBuf,
        /// What is expected there.
        remedy: &'static str,
    },
    /// A file of the recording cannot be understood.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        what: String,
    },
    /// Something is wrong with one camera.
    #[error("camera {camera}: {}: {what}", path.display())]
    Camera {
        /// The camera's name.
        camera: String,
        /// The file that says so.
        path: PathBuf,
        /// What is wrong, and what to do.
        what: String,
    },
    /// No camera of a rig recorded a stream of a session.
    #[error(
        "no camera of the rig file has a stream in {}: the rig has {}, the session {}",
        path.display(),
        cameras.join(", "),
        streams.join(", ")
    )]
    NoViewpoint {
        /// The session.
        path: PathBuf,
        /// The rig's cameras.
        cameras: Vec<String>,
        /// The session's streams.
        streams: Vec<String>,
    },
    /// A frame of one camera cannot be read or written.
    #[error("camera {camera}: {source}")]
    Image {
        /// The camera's name.
        camera: String,
        /// Why.
        source: ImageError,
    },
    /// A video of one camera cannot be read.
    #[error("camera {camera}: {source}")]
    Video {
        /// The camera's name.
        camera: String,
        /// Why.
        source: VideoError,
    },
    /// A file of another program cannot be used.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// A recorded session cannot be read.
    #[error(transparent)]
    Session(Box<ContainerError>),
    /// Events cannot be written.
    #[error("camera {camera}: {source}")]
    Events {
        /// The camera's name.
        camera: String,
        /// Why.
        source: Box<NpzError>,
    },
    /// A COLMAP model cannot be used.
    #[error(transparent)]
    Colmap(#[from] ColmapError),
    /// The dataset cannot be written, or the recording makes no valid one.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
}

impl From<ContainerError> for ImportError {
    fn from(error: ContainerError) -> Self {
        Self::Session(Box::new(error))
    }
}
