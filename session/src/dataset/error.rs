//! What can be wrong with a dataset.

use std::path::PathBuf;

use crate::{image::ImageError, npz::NpzError, ply::PlyError};

/// What can go wrong with a dataset. Each message names the file or camera and what to do.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// There is no manifest.
    #[error("{} holds no dataset.json; make a dataset with `erfgs dataset import`", path.display())]
    NotADataset {
        /// The folder.
        path: PathBuf,
    },
    /// A file cannot be opened, read or written.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// `read` or `write`.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The manifest is no manifest.
    #[error("{} is malformed: {source}; see docs/dataset.md for the format", path.display())]
    Json {
        /// The manifest.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// Another format or version.
    #[error(
        "{} has format `{format}` version {version}, but this program reads `{}` version {}; import the recording again",
        path.display(), super::Manifest::FORMAT, super::Manifest::VERSION
    )]
    Version {
        /// The manifest.
        path: PathBuf,
        /// Its format.
        format: String,
        /// Its version.
        version: u32,
    },
    /// The manifest names a file outside its folder.
    #[error("the manifest names the file `{}`, which is not inside the dataset's folder; use relative paths without `..`", file.display())]
    Outside {
        /// The file as named.
        file: PathBuf,
    },
    /// A frame or mask cannot be read.
    #[error("camera {camera}: {source}")]
    Image {
        /// The camera's name.
        camera: String,
        /// Why.
        source: ImageError,
    },
    /// A frame or mask has the wrong size.
    #[error(
        "camera {camera}: {} has {} x {} pixels, but the intrinsics say {} x {}; correct one of them",
        path.display(), found[0], found[1], named[0], named[1]
    )]
    ImageSize {
        /// The camera's name.
        camera: String,
        /// The image.
        path: PathBuf,
        /// Its width and height.
        found: [u32; 2],
        /// The intrinsics' width and height.
        named: [u32; 2],
    },
    /// An event file cannot be read.
    #[error("camera {camera}: {source}")]
    Events {
        /// The camera's name.
        camera: String,
        /// Why.
        source: Box<NpzError>,
    },
    /// An event file holds another number of events.
    #[error("camera {camera}: {} holds {found} events, but the manifest says {named}; simulate or import them again", path.display())]
    EventCount {
        /// The camera's name.
        camera: String,
        /// The event file.
        path: PathBuf,
        /// Events in the file.
        found: u64,
        /// Events in the manifest.
        named: u64,
    },
    /// The initial point cloud cannot be read.
    #[error(transparent)]
    Points {
        /// Why.
        source: Box<PlyError>,
    },
    /// The initial point cloud holds another number of points.
    #[error("{} holds {found} points, but the manifest says {named}; make the point cloud again", path.display())]
    PointCount {
        /// The point cloud.
        path: PathBuf,
        /// Points in the file.
        found: u64,
        /// Points in the manifest.
        named: u64,
    },
    /// The manifest contradicts itself or the files.
    #[error("{}: {what}; {remedy}", path.display())]
    Invalid {
        /// The manifest or the file in question.
        path: PathBuf,
        /// What is wrong, with the camera's name.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
}
