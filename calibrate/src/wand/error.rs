//! What can go wrong with a calibration by wand.

use std::path::PathBuf;

use erfgs_base::FileError;

use crate::bundle::BundleError;
use erfgs_scene::{exchange::ExchangeError, rig_file::RigFileError};
use erfgs_session::container::ContainerError;

/// What can go wrong with a calibration by wand.
#[derive(Debug, thiserror::Error)]
pub enum WandError {
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file cannot be understood.
    #[error("{}{}: {what}", path.display(), line.map(|line| format!(", line {line}")).unwrap_or_default())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where, counted from 1.
        line: Option<usize>,
        /// What is wrong.
        what: String,
    },
    /// A file of intrinsics cannot be read.
    #[error(transparent)]
    Intrinsics(#[from] ExchangeError),
    /// A folder without points.
    #[error(
        "{} holds no wand points: neither wand.json nor files such as frame_0.csv with frame_0.yaml beside them",
        folder.display()
    )]
    NoPoints {
        /// Where they were looked for.
        folder: PathBuf,
    },
    /// A rig with known intrinsics cannot be read.
    #[error(transparent)]
    Rig(#[from] RigFileError),
    /// A session cannot be read.
    #[error(transparent)]
    Session(#[from] ContainerError),
    /// A session of which fewer than two cameras have known intrinsics.
    #[error(
        "a wand in a session needs known intrinsics: give a rig file that has them with --rig; there are none for {}",
        cameras.join(", ")
    )]
    NoIntrinsics {
        /// The cameras without.
        cameras: Vec<String>,
    },
    /// An event camera of a session whose clock is not known.
    #[error("stream {stream} has no clock; `erfgs sync` shows the reason")]
    NoClock {
        /// The stream.
        stream: String,
    },
    /// An event camera of a session without a size that a sensor can have.
    #[error("the sensor size of stream {stream} is invalid; record the session again")]
    SensorSize {
        /// The stream.
        stream: String,
    },
    /// An option that makes no sense.
    #[error("{0}")]
    Option(String),
    /// Fewer than two cameras.
    #[error("a wand ties cameras together, and there {}", if *cameras == 1 { "is only one" } else { "are none" })]
    TooFewCameras {
        /// How many there are.
        cameras: usize,
    },
    /// Cameras that never saw the wand.
    #[error(
        "{} never saw the wand; check the detection there, wave the wand before it, or leave it out with --without",
        names(cameras)
    )]
    Unseen {
        /// Their names.
        cameras: Vec<String>,
    },
    /// No camera of the rig that shall hold saw the wand.
    #[error(
        "none of {} has a pose in the rig of --keep-poses; its cameras must see the wand, too, under the same names",
        names(cameras)
    )]
    NoneKept {
        /// The cameras that saw it.
        cameras: Vec<String>,
    },
    /// A camera with hardly any placement.
    #[error(
        "camera {camera} has {found} usable wand placements in common with other cameras, and needs {needed}; wave the \
         wand where it and others see it, or leave it out with --without"
    )]
    TooFew {
        /// Its name.
        camera: String,
        /// What there is.
        found: usize,
        /// What is needed.
        needed: usize,
    },
    /// Cameras that nothing ties together.
    #[error(
        "the cameras fall into {} groups that too few wand placements tie together: {}; the most that two cameras of \
         different groups share is {shared} placements ({needed} are needed, and they must agree). Wave the wand where \
         cameras of both groups see it at the same time",
        groups.len(),
        groups.iter().map(|group| format!("[{}]", group.join(", "))).collect::<Vec<_>>().join(" and ")
    )]
    Groups {
        /// The groups, by the names of their cameras.
        groups: Vec<Vec<String>>,
        /// The most placements that two cameras of different groups share.
        shared: usize,
        /// How many are needed.
        needed: usize,
    },
    /// Observations that leave parameters open.
    #[error(
        "the wand placements do not determine {}; wave the wand where that camera and others see it, in other places, \
         directions and distances",
        what.join("; ")
    )]
    Open {
        /// What, in words.
        what: Vec<String>,
    },
    /// The adjustment could not be set up.
    #[error(transparent)]
    Bundle(#[from] BundleError),
}

fn names(cameras: &[String]) -> String {
    let word = if cameras.len() == 1 { "camera" } else { "cameras" };
    format!("{word} {}", cameras.join(", "))
}
