//! What can go wrong while a rig is calibrated from images of its surroundings.

use std::path::PathBuf;

use erfgs_base::FileError;

use crate::{bundle::BundleError, colmap::RunError};

/// What can go wrong while a rig is calibrated from images of its surroundings.
#[derive(Debug, thiserror::Error)]
pub enum SfmError {
    /// Too few views.
    #[error("{} has {found} images, one per camera, and at least 3 are needed", path.display())]
    TooFewViews {
        /// The folder or dataset.
        path: PathBuf,
        /// How many there are.
        found: usize,
    },
    /// A camera that has no such frame.
    #[error("camera {camera} has no frame {frame} ({has} in all); choose another with --frame")]
    NoFrame {
        /// Its name.
        camera: String,
        /// Which was wanted.
        frame: usize,
        /// How many there are.
        has: usize,
    },
    /// Images of a camera whose order is not known.
    #[error("camera {camera}: {doubt}")]
    Order {
        /// The camera.
        camera: String,
        /// Two of them, and why.
        doubt: erfgs_base::order::Doubt,
    },
    /// An image that is not of its camera.
    #[error(
        "camera {camera}: the image has {} x {} pixels, and its intrinsics are for {} x {}; give images of the full \
         size, or intrinsics of this size", image[0], image[1], intrinsics[0], intrinsics[1]
    )]
    Size {
        /// The camera.
        camera: String,
        /// Width and height of the image.
        image: [u32; 2],
        /// Width and height of the intrinsics.
        intrinsics: [u32; 2],
    },
    /// A camera without intrinsics.
    #[error("camera {camera} has no intrinsics in {}; add it, or leave all intrinsics unknown", path.display())]
    NoIntrinsics {
        /// The camera.
        camera: String,
        /// Where it was looked for.
        path: PathBuf,
    },
    /// A camera that is named and not there.
    #[error("there is no camera '{camera}' with a pose ({what}); there are: {has}")]
    NoCamera {
        /// Its name.
        camera: String,
        /// What it was named for.
        what: &'static str,
        /// Which there are.
        has: String,
    },
    /// An image that cannot be read.
    #[error("camera {camera}: {source}")]
    Image {
        /// The camera.
        camera: String,
        /// Why.
        source: erfgs_scene::image::ImageError,
    },
    /// A file or folder that cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A dataset that cannot be read.
    #[error(transparent)]
    Dataset(#[from] erfgs_dataset::DatasetError),
    /// COLMAP does not run.
    #[error(transparent)]
    Colmap(#[from] RunError),
    /// A model cannot be read.
    #[error(transparent)]
    Model(#[from] erfgs_scene::colmap::ColmapError),
    /// The bundle cannot be set up.
    #[error(transparent)]
    Bundle(#[from] BundleError),
    /// No model at all.
    #[error(
        "no arrangement of the {views} cameras was found ({runs}); the images need texture and neighbouring cameras must \
         see the same things from less than some 30 degrees apart: try another --frame, give the intrinsics (--rig), or \
         calibrate with a wand"
    )]
    NoModel {
        /// Number of views.
        views: usize,
        /// What the runs came to.
        runs: String,
    },
    /// Two models with nothing in common.
    #[error(
        "the cameras fall into groups that share nothing: {first} | {second}; add cameras or texture between them, or \
         calibrate with a wand"
    )]
    Disconnected {
        /// Names of the first group.
        first: String,
        /// Names of the second.
        second: String,
    },
    /// Cameras that cannot be registered.
    #[error(
        "{cameras} could not be registered: fewer than {needed} of the model's {points} points are seen ({found}); \
         the images must show the same scene as the model's, from less than some 30 degrees off: use a brighter ramp, or place \
         them with a wand"
    )]
    Unregistered {
        /// Their names.
        cameras: String,
        /// How many points are needed.
        needed: usize,
        /// How many the model has.
        points: usize,
        /// How many each camera sees.
        found: String,
    },
    /// Runs that contradict each other.
    #[error(
        "independent runs disagree on the camera poses, so that no result can be trusted: {agree} of {views} cameras agree in two \
         runs ({}); in doubt: {doubtful}. Repeating texture causes this: try another \
         --frame, give the intrinsics (--rig or --known-intrinsics), or calibrate with a wand",
        runs
    )]
    Disagreement {
        /// How many cameras agree in the best pair of runs.
        agree: usize,
        /// Number of views.
        views: usize,
        /// What the runs came to.
        runs: String,
        /// Names of the others.
        doubtful: String,
    },
}
