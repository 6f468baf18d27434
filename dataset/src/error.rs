//! What can be wrong with a dataset.

use std::{
    io,
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, atomic::NewFolder, plausible::Implausible};
use erfgs_events::npz::NpzError;
use erfgs_scene::{image::ImageError, ply::PlyError};

/// What can go wrong with a dataset. Each message names the file or camera and what to do.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// There is no manifest.
    #[error("{} holds no dataset.json; make a dataset with `erfgs dataset import`", path.display())]
    NotADataset {
        /// The folder.
        path: PathBuf,
    },
    /// The folder of a new dataset is not empty.
    #[error("{} already exists and is not an empty folder; name another one with --out or remove it", path.display())]
    OutputExists {
        /// The folder.
        path: PathBuf,
    },
    /// A file cannot be opened, read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The manifest is no manifest.
    #[error("{} is malformed: {source}; see docs/reference/dataset.md for the format", path.display())]
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
    /// The initial point cloud cannot be read or written.
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
    /// The initial point cloud holds a point that is nowhere.
    #[error("{}: point {index}: {wrong}", path.display())]
    Point {
        /// The point cloud.
        path: PathBuf,
        /// Number of the point, from 0.
        index: usize,
        /// Which number.
        wrong: Implausible,
    },
    /// The times of the points are not told as they should be.
    #[error("{}: the point cloud's parameter `runs`: {reason}; make the point cloud again with `erfgs dataset points`", path.display())]
    PointRuns {
        /// The manifest.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The bodies make no sense.
    #[error("{}: {reason}; find the bodies again with `erfgs dataset bodies`", path.display())]
    Bodies {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The file of another program cannot be written.
    #[error(transparent)]
    Exchange(#[from] erfgs_scene::exchange::ExchangeError),
    /// A COLMAP model cannot be written.
    #[error(transparent)]
    Colmap(#[from] erfgs_scene::colmap::ColmapError),
    /// The manifest contradicts itself or the files.
    #[error("{}: {problem}", path.display())]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// What is wrong.
        problem: Box<Problem>,
    },
    /// The manifest contradicts itself or the files in one camera.
    #[error("{}: camera {camera}: {problem}", path.display())]
    Camera {
        /// The manifest.
        path: PathBuf,
        /// The camera's name.
        camera: String,
        /// What is wrong.
        problem: Box<Problem>,
    },
    /// A dataset cannot be made wrong in this way.
    #[error("{option} is {value}; it may be {allowed}")]
    Disturbance {
        /// What was asked for.
        option: &'static str,
        /// How it was given.
        value: String,
        /// What it may be.
        allowed: &'static str,
    },
    /// A file is not the one that the manifest was written for.
    #[error("{} has changed since the dataset was made; copy it again or make the dataset anew", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// The manifest has no hash of a file.
    #[error("the manifest has no SHA-256 of {}; make the dataset anew", path.display())]
    NoHash {
        /// The file.
        path: PathBuf,
    },
}

impl DatasetError {
    /// Begins the folder of a new dataset.
    pub(crate) fn new_folder(path: &Path) -> Result<NewFolder, Self> {
        NewFolder::begin(path).map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => Self::OutputExists { path: path.to_owned() },
            _ => FileError::when("write", path)(source).into(),
        })
    }
}

/// What is wrong with a manifest, and what to do about it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// No cameras.
    #[error("it names no camera; import the recording again")]
    NoCameras,
    /// A span without length.
    #[error("the span {0:?} ns ends before it begins; set `span_ns` to the first and last instant of the recording")]
    Span([i64; 2]),
    /// A name that cannot be a folder's.
    #[error("the name is not a valid folder name; use letters, digits, `-`, `_` and `.`")]
    Name,
    /// Two cameras of one name.
    #[error("the name comes twice; give each camera its own")]
    NameTwice,
    /// A number that no camera, clock or sensor has.
    #[error(transparent)]
    Implausible(#[from] Implausible),
    /// The same of a frame.
    #[error("frame {index} ({}): {wrong}", file.display())]
    Frame {
        /// Number of the frame in the camera.
        index: usize,
        /// Its image.
        file: PathBuf,
        /// Which number.
        wrong: Implausible,
    },
    /// A lens that no pinhole can replace.
    #[error(
        "the lens model is not valid over the whole image, which therefore cannot be undistorted; calibrate the lens again"
    )]
    Lens,
    /// Frames or events do not fit the modality.
    #[error("the modality `{modality}` does not fit {frames} frames and {} event file; correct `modality`", if *events { "an" } else { "no" })]
    Modality {
        /// The modality's name.
        modality: &'static str,
        /// How many frames there are.
        frames: usize,
        /// Whether there is an event file.
        events: bool,
    },
    /// Frames out of order.
    #[error("frame {index} ({}) at {t_ns} ns does not come after the one before it; sort the frames by time", file.display())]
    Order {
        /// Number of the frame in the camera.
        index: usize,
        /// Its image.
        file: PathBuf,
        /// Its time.
        t_ns: i64,
    },
    /// A frame outside the span.
    #[error("frame {index} ({}) at {t_ns} ns lies outside the span {span_ns:?} ns; correct `t_ns` or `span_ns`", file.display())]
    OutsideSpan {
        /// Number of the frame in the camera.
        index: usize,
        /// Its image.
        file: PathBuf,
        /// Its time.
        t_ns: i64,
        /// The recording's span.
        span_ns: [i64; 2],
    },
    /// An exposure that ends before it starts, or elsewhere.
    #[error("frame {index} ({}) at {t_ns} ns lies outside its exposure {exposure_ns:?} ns; correct `exposure_ns`", file.display())]
    Exposure {
        /// Number of the frame in the camera.
        index: usize,
        /// Its image.
        file: PathBuf,
        /// Its time.
        t_ns: i64,
        /// Its exposure.
        exposure_ns: [i64; 2],
    },
    /// A number of its events that no sensor has.
    #[error("the event file {}: {wrong}; simulate or import the events again", file.display())]
    Sensor {
        /// The event file.
        file: PathBuf,
        /// Which number.
        wrong: Implausible,
    },
    /// Event parameters that make no sense.
    #[error("the event file {}: {what}; simulate or import the events again", file.display())]
    CameraEvents {
        /// The event file.
        file: PathBuf,
        /// What is wrong.
        what: &'static str,
    },
    /// A file named for two purposes.
    #[error("the file {} is named twice; give each frame and each camera its own", .0.display())]
    FileTwice(PathBuf),
    /// A file that does not exist.
    #[error("the file {} does not exist; copy it there or import the recording again", .0.display())]
    MissingFile(PathBuf),
}
