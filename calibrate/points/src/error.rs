//! What can go wrong while the initial point cloud is made.

use std::path::PathBuf;

use erfgs_base::FileError;
use erfgs_calibrate::colmap::RunError;

/// What can go wrong while the initial point cloud is made.
#[derive(Debug, thiserror::Error)]
pub enum CloudError {
    /// Three views are needed to tell a right point from a wrong one.
    #[error(
        "the initial point cloud needs at least 3 training cameras with frames, and the dataset has {found}; \
         give more cameras frames, or train from random points: erfgs train DATASET --init random"
    )]
    TooFewCameras {
        /// How many there are.
        found: usize,
    },
    /// No time at which three cameras have a frame.
    #[error(
        "there is no time at which 3 training cameras have a frame (frames count as simultaneous within \
         {tolerance_ns} ns, or, where cameras run freely, within half an interval); check the frame times in dataset.json"
    )]
    NoCommonInstant {
        /// How far apart simultaneous frames may be labelled.
        tolerance_ns: i64,
    },
    /// A frame that was asked for by name is missing.
    #[error("no frame called '{name}' is shared by 3 training cameras; image files are named without their extension")]
    UnknownFrame {
        /// What was asked for: a file name without its extension.
        name: String,
    },
    /// A pose or intrinsics that no image can be projected with.
    #[error("camera {camera}: {why}; correct its entry in dataset.json")]
    DegenerateCamera {
        /// Name of the camera.
        camera: String,
        /// What is wrong with it.
        why: String,
    },
    /// All cameras stand at one place.
    #[error(
        "all {cameras} training cameras stand within {spread_m:e} m of each other: without a baseline there is no depth; check the poses"
    )]
    NoBaseline {
        /// How many cameras.
        cameras: usize,
        /// Their greatest distance.
        spread_m: f64,
    },
    /// An option that makes no sense.
    #[error("option {option}: {why}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// What is wrong with it.
        why: String,
    },
    /// An image cannot be read or does not fit its camera, or the dataset cannot be written.
    #[error(transparent)]
    Dataset(#[from] erfgs_dataset::DatasetError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Neither a program nor pycolmap.
    #[error(
        "COLMAP was not found ({tried}); install it (Debian, Ubuntu: apt install colmap; any system: pip install \
         pycolmap), or name it with --colmap PATH or --colmap pycolmap:PYTHON, or do without: --init sweep, --init random"
    )]
    ColmapMissing {
        /// What was tried.
        tried: String,
    },
    /// COLMAP does not run, or its database is not as expected.
    #[error(transparent)]
    Colmap(RunError),
    /// COLMAP's model cannot be read or written.
    #[error(transparent)]
    Model(#[from] erfgs_scene::colmap::ColmapError),
    /// COLMAP's model does not fit the database it was made from.
    #[error("COLMAP's triangulated model does not fit its database: {why}; try another version of COLMAP")]
    ModelMismatch {
        /// What is wrong.
        why: String,
    },
    /// The point cloud cannot be written.
    #[error(transparent)]
    Ply(#[from] erfgs_scene::ply::PlyError),
    /// Nothing to match.
    #[error(
        "COLMAP found only {found} features in {images} images; the images may be black, tiny or blurred: try other \
         frames, or a lower peak threshold, or --init sweep or random"
    )]
    TooFewFeatures {
        /// How many features.
        found: usize,
        /// In how many images.
        images: usize,
    },
    /// No hulls that bodies could be found in.
    #[error(
        "bodies need moving points at several instants, and the dataset has them at {instants}; make them with `erfgs dataset \
         points` (not with --moving 0)"
    )]
    NoMovingPoints {
        /// At how many instants there are any.
        instants: usize,
    },
    /// What moves could not be followed.
    #[error(
        "nothing could be tracked through the {instants} instants with moving points; make points at more instants (`erfgs dataset \
         points --moving N`), or train without bodies"
    )]
    NoBodies {
        /// At how many instants there are moving points.
        instants: usize,
    },
    /// Corrections of bodies that cannot be made.
    #[error("the corrections of bodies cannot be made: {why}")]
    BodyEdits {
        /// What is wrong with them.
        why: String,
    },
    /// A file of corrections that is none.
    #[error(
        "{}: {}\nforget, merge, carve, [[split]] and [[turn]] can be said; `erfgs dataset bodies --help` has an example",
        path.display(),
        why.trim_end()
    )]
    BodyEditsFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// Next to nothing was found.
    #[error(
        "the {method} cloud has only {found} points (at least {needed} are needed); check that poses and intrinsics \
         belong to the images, widen the depth range, or use --init random"
    )]
    TooFewPoints {
        /// How the cloud is made, as `--init` names it.
        method: &'static str,
        /// How many points it found.
        found: usize,
        /// How many are needed.
        needed: usize,
    },
}

impl From<RunError> for CloudError {
    /// There are methods that need no COLMAP, which a message about a missing one should say.
    fn from(error: RunError) -> Self {
        match error {
            RunError::Missing { tried } => Self::ColmapMissing { tried },
            other => Self::Colmap(other),
        }
    }
}
