//! What can go wrong with a board calibration.

use std::path::PathBuf;

use erfgs_base::FileError;
use erfgs_events::EventFileError;
use erfgs_scene::{image::ImageError, rig_file::RigFile, video::VideoError};
use erfgs_session::container::ContainerError;

use super::PlateError;
use crate::{bundle::BundleError, evidence::Evidence};

/// What can go wrong with a board calibration.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// A folder cannot be listed.
    #[error(transparent)]
    File(#[from] FileError),
    /// There is nothing to look at.
    #[error(
        "{} holds neither images (png, jpg, ppm), nor videos, nor folders of images{holds}; give one folder or video for each camera, or \
         images whose names begin with the camera's (left01.png, right01.png)",
        path.display()
    )]
    NoImages {
        /// The folder.
        path: PathBuf,
        /// What it holds, in words.
        holds: String,
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
    #[error("{} holds events: give the blink rate of the board with --blink, or --moving for a printed board that moves", path.display())]
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
    #[error("{} holds no frames; for event cameras give the blink rate of the board with --blink, or --moving for a printed board \
    that moves", path.display())]
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
        "camera {camera}: the board is seen in {seen} of {frames} frames of {}{}, and at least {needed} are needed; {hint}check --target \
         ({target}), and show the board whole, sharp and tilted in different ways",
        path.display(),
        if usable < seen { format!(", in {usable} of them with six corners or more") } else { String::new() }
    )]
    TooFewViews {
        /// The camera.
        camera: String,
        /// What was looked at.
        path: PathBuf,
        /// Frames with a board.
        seen: usize,
        /// Those that show enough of it.
        usable: usize,
        /// What else may be the matter, with a space behind; mostly nothing.
        hint: Box<str>,
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
        "no board is seen by two cameras at once ({} and {}), so that their poses cannot be tied; record the board where two of \
         them see it, name pictures of one instant alike, or check the frame times",
        one.join(", "),
        other.join(", ")
    )]
    Apart {
        /// The first camera.
        one: Vec<String>,
        /// The others.
        other: Vec<String>,
        /// Each camera by itself: the intrinsics are sound.
        alone: Box<(RigFile, Evidence)>,
    },
    /// Two targets that are no two sides of a board.
    #[error(transparent)]
    Plate(#[from] PlateError),
    /// A thickness of a board that has none.
    #[error("a board of {thickness_m} m is none; --back-thickness is in millimetres, from 0 to 200")]
    Thickness {
        /// What was stated, metres.
        thickness_m: f64,
    },
    /// Cameras that only the two sides of a board tie, of which it remains open where they are to each other.
    #[error(
        "{} see the front of the board where {} see its back, and where the back is on the board does not follow from these \
         views ({known}): turn it by 30 degrees and more about both its axes before cameras of both kinds at once, let a camera \
         between them see it with either of them, or say with --back-thickness how thick it is (sides parallel, one behind the \
         other)",
        front.join(", "),
        back.join(", ")
    )]
    BackOpen {
        /// Cameras that see the front.
        front: Vec<String>,
        /// Cameras that see the back at the same instants.
        back: Vec<String>,
        /// How well the back is known.
        known: String,
        /// Each camera by itself: the intrinsics are sound.
        alone: Box<(RigFile, Evidence)>,
    },
    /// A solution that is none.
    #[error(
        "this is no rig: {what}. {}{}Check that {times}the recordings belong together, the target has the size and kind that \
         --target says, the board is stiff and flat, and no camera moved",
        if tried.is_empty() { String::new() } else { format!("Tried: {tried}. ") },
        if *lenses {
            "Better than lenses that are kept are those of a recording of their own, in which each camera sees the board in all parts \
             of its image (--rig). "
        } else {
            ""
        }
    )]
    Contradiction {
        /// What speaks against it.
        what: String,
        /// What was tried, and what came of it.
        tried: String,
        /// Whether keeping the lenses helps, so that better ones will.
        lenses: bool,
        /// What is said of synchronisation.
        times: String,
    },
    /// A camera that does not exist is to be left out.
    #[error("there is no camera {name} to be left out; the cameras are {}", cameras.join(", "))]
    NoCamera {
        /// The name.
        name: String,
        /// Those that were recorded.
        cameras: Vec<String>,
    },
    /// An instant that does not exist is to tie no cameras.
    #[error(
        "the board was not seen at an instant {name}, of which --untie speaks; the instants are {} and so on",
        known.join(", ")
    )]
    NoInstant {
        /// What was asked for.
        name: String,
        /// The first ones that there are.
        known: Vec<String>,
    },
    /// The intrinsics that are known are of other cameras.
    #[error(
        "the rig file has intrinsics of {}, and the recording is of {}; rename the folders or the cameras in the file",
        known.join(", "),
        cameras.join(", ")
    )]
    KnowsNone {
        /// The cameras of the file.
        known: Vec<String>,
        /// Those that were recorded.
        cameras: Vec<String>,
    },
    /// The intrinsics that are known are of another size of image.
    #[error(
        "camera {camera}: the rig file has the intrinsics of images of {}x{} pixels, and these are of {}x{}; calibrate the \
         intrinsics with images of this size, or record in that one",
        known[0], known[1], found[0], found[1]
    )]
    KnownSize {
        /// The camera.
        camera: String,
        /// The size in the file.
        known: [u32; 2],
        /// That of the recording.
        found: [u32; 2],
    },
    /// No board of this name.
    #[error(
        "no board that took part was seen at the instant {name}, which is to be the origin; the instants are {} and so on",
        known.join(", ")
    )]
    NoOrigin {
        /// What was asked for.
        name: String,
        /// The first ones that there are.
        known: Vec<String>,
    },
    /// The adjustment cannot be set up.
    #[error(transparent)]
    Bundle(#[from] BundleError),
}
