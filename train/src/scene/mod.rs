//! A dataset as the trainer uses it: views, frames packed for the device, binned events, held-out frames.

mod events;
mod load;
mod motion;
mod near;

use std::path::PathBuf;

use erfgs_dataset::{Dataset, DatasetError, Split};

pub use events::{Bins, EventView};
pub use motion::{MotionMasks, classify, project};
pub use near::near_plane;

use crate::raster::{RasterError, View};

/// Why a dataset cannot be trained on.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file of the dataset could not be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A camera cannot be rendered.
    #[error("camera '{camera}': {source}")]
    Camera {
        /// Its name.
        camera: String,
        /// Why.
        source: RasterError,
    },
    /// There is nothing to train on.
    #[error("dataset '{path}' has no training camera with frames; import one with frames, or leave some cameras RGB")]
    NoFrames {
        /// The dataset.
        path: PathBuf,
    },
    /// There is no initial point cloud.
    #[error(
        "dataset '{path}' has no initial point cloud; make one with `erfgs dataset points {path}`, or start from random points with `--init random`"
    )]
    NoPoints {
        /// The dataset.
        path: PathBuf,
    },
    /// The cameras of a random start enclose nothing.
    #[error(
        "the cameras of dataset '{path}' stand at one point, so that no box for random points follows from them; make a point cloud with `erfgs dataset points {path}`"
    )]
    NoExtent {
        /// The dataset.
        path: PathBuf,
    },
}

/// A point of the initial cloud: position (metres) and colour.
pub type Point = ([f32; 3], [u8; 3]);

/// A camera.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneView {
    /// Its name in the dataset.
    pub name: String,
    /// Whether it is held out.
    pub split: Split,
    /// What the rasteriser needs.
    pub view: View,
}

/// A training frame.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainFrame {
    /// Index into [`Scene::views`].
    pub view: usize,
    /// Which frame of its camera.
    pub index: usize,
    /// The time of its label, in [0, 1].
    pub t01: f64,
    /// Its exposure, in [0, 1].
    pub exposure: [f64; 2],
    /// Pixels, row-major, red in the lowest byte, alpha 255.
    pub pixels: Vec<u32>,
}

/// A held-out frame, read when it is needed.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldOutFrame {
    /// Index into [`Scene::views`].
    pub view: usize,
    /// Which frame of its camera.
    pub index: usize,
    /// Its time, nanoseconds.
    pub t_ns: i64,
    /// Its time, in [0, 1].
    pub t01: f64,
}

/// A dataset in the form that the trainer uses.
#[derive(Debug)]
pub struct Scene {
    /// The dataset.
    pub dataset: Dataset,
    /// All cameras, in the dataset's order.
    pub views: Vec<SceneView>,
    /// All training frames.
    pub frames: Vec<TrainFrame>,
    /// The event cameras.
    pub events: Vec<EventView>,
    /// The bins that events are counted in.
    pub bins: Bins,
    /// Frames of held-out cameras.
    pub held_out: Vec<HeldOutFrame>,
    /// The initial cloud.
    pub points: Vec<Point>,
    /// Times of the training frames, each once, ascending, in [0, 1].
    pub frame_times: Vec<f64>,
    /// 1.1 times the largest distance of a training camera from their mean, metres: the unit of learning rates and sizes.
    pub extent: f32,
    /// Whether exposures gathered light (true) or display values (false, as simulated blur does).
    pub linear_exposure: bool,
}

impl Scene {
    /// Nanoseconds to [0, 1].
    #[must_use]
    pub fn to_unit(&self, t_ns: i64) -> f64 {
        let [start, end] = self.dataset.manifest.span_ns;
        if end > start { (t_ns - start) as f64 / (end - start) as f64 } else { 0.0 }
    }

    /// Whether any frame was exposed for longer than an instant.
    #[must_use]
    pub fn has_blur(&self) -> bool {
        self.frames.iter().any(|frame| frame.exposure[1] > frame.exposure[0])
    }

    /// The largest number of pixels of a training view.
    #[must_use]
    pub fn max_pixels(&self) -> u32 {
        self.views.iter().map(|view| view.view.width * view.view.height).max().unwrap_or(0)
    }
}
