//! What can go wrong with a board calibration.

use std::path::PathBuf;

use erfgs_base::FileError;
use erfgs_events::EventFileError;
use erfgs_scene::{image::ImageError, video::VideoError};
use erfgs_session::container::ContainerError;

use crate::bundle::BundleError;

/// What can go wrong with a board calibration.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// A folder cannot be listed.
    #[error(transparent)]
    File(#[from] FileError),
    /// There is nothing to look at.
    #[error(
        "{} holds neither images, nor videos, nor folders of images; give one folder or video for each camera, or images whose \
         names begin with the camera's (left01.png, right01.png)",
        path.display()
    )]
    NoImages {
        /// The folder.
        path: PathBuf,
    },
    /// An image cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A video cannot be read.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// A file of events cannot be read.
    #[error(transparent)]
    Events(#[from] EventFileError),
    /// A file of events without the sensor's size.
    #[error("{} does not say how large the sensor is; record or export it as RAW, DAT or AEDAT4", path.display())]
    NoSize {
        /// The file.
        path: PathBuf,
    },
    /// Events of a board of which nobody said whether it blinks or moves.
    #[error("{} holds events: say with --blink how often the board comes and goes in a second, or with --moving that a printed one moves", path.display())]
    NoBlink {
        /// The file.
        path: PathBuf,
    },
    /// A frame that was there before.
    #[error("{} no longer holds frame {frame}, in which the board was found; was it changed meanwhile?", path.display())]
    NoFrame {
        /// The file.
        path: PathBuf,
        /// Its number, counted from 0.
        frame: u64,
    },
    /// A session cannot be read.
    #[error(transparent)]
    Session(#[from] ContainerError),
    /// A session of which nothing can be looked at.
    #[error("{} holds no frames; for event cameras say with --blink how often the board comes and goes in a second, or with --moving that a printed one moves", path.display())]
    NoFrames {
        /// The session.
        path: PathBuf,
    },
    /// A camera's images are not all of one size.
    #[error("camera {camera}: {} is {found:?} pixels, the images before it {expected:?}; sort the images by camera", path.display())]
    Size {
        /// The camera.
        camera: String,
        /// The odd image.
        path: PathBuf,
        /// Its size.
        found: [u32; 2],
        /// The others' size.
        expected: [u32; 2],
    },
    /// Frame times that cannot be used.
    #[error("{}: {what}", path.display())]
    Times {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The board is not seen often enough.
    #[error(
        "camera {camera}: the board is seen in {seen} of {frames} frames, and at least {needed} are needed; check --target \
         ({target}), and show the board whole, sharp and tilted in different ways"
    )]
    TooFewViews {
        /// The camera.
        camera: String,
        /// Frames with a board.
        seen: usize,
        /// All frames.
        frames: usize,
        /// How many are needed.
        needed: usize,
        /// The board that was looked for, as `--target` names it.
        target: String,
    },
    /// No focal length follows from the views.
    #[error(
        "camera {camera}: its {views} views of the board do not determine the focal length{}, because the board hardly tilts \
         against the image; add views tilted by 30 degrees or more about both axes, near and far, or give the intrinsics (--rig)",
        found.map(|[focal, sigma]| format!(" ({focal:.0} ± {sigma:.0} px)")).unwrap_or_default()
    )]
    NoFocal {
        /// The camera.
        camera: String,
        /// Number of views.
        views: usize,
        /// The focal length that fits best and its standard deviation, pixels, where there is one.
        found: Option<[f64; 2]>,
    },
    /// The adjustment leaves something open.
    #[error("the views do not determine {what}; add views that differ in tilt and distance, or fix what is known")]
    Open {
        /// The directions that are open: cameras and their parameters.
        what: String,
    },
    /// Cameras that cannot be tied together.
    #[error(
        "the board is never seen by a camera of the group [{}] and one of the group [{}] at once, so that their poses cannot be \
         tied; record the board where both see it, or check the frame times",
        one.join(", "),
        other.join(", ")
    )]
    Apart {
        /// Cameras that are tied to each other.
        one: Vec<String>,
        /// Cameras that are tied to none of those.
        other: Vec<String>,
    },
    /// The adjustment cannot be set up.
    #[error(transparent)]
    Bundle(#[from] BundleError),
}
