//! A dataset as the trainer uses it: views, frames packed for the device, binned events, held-out frames.

mod balance;
mod bins;
mod counts;
mod displacement;
mod events;
#[cfg(test)]
pub(crate) mod fixtures;
mod flicker;
mod load;
mod memory;
mod motion;
mod pictures;
mod still;
mod words;

use std::path::PathBuf;

use erfgs_dataset::{Body, Dataset, DatasetError, Split};
use glam::DVec3;

pub use bins::Bins;
pub(crate) use counts::Way;
pub(crate) use displacement::{exposed, moves};
pub use events::EventView;
pub(crate) use events::Numbers;
pub use flicker::Flicker;
pub(crate) use load::{extent, median};
pub(crate) use memory::check as check_memory;
pub(crate) use motion::grow;
pub use motion::{MotionMasks, classify, project};
pub use pictures::{Pictures, Pixels};
pub(crate) use still::stands_still;

use crate::{
    config::Config,
    start::{Piece, Recording, from_bodies, pieces, thin},
};
use erfgs_splat::{
    motion::bodies::Start,
    raster::{RasterError, View},
};

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
    /// The motion model starts from points that move, and there are none.
    #[error(
        "dataset '{path}' has no moving points, which `motion = \"free-time\"` starts from; make the points again with `erfgs dataset points {path}` (each camera needs four frames, and something must move), or train with --motion hexplane"
    )]
    NoMovingPoints {
        /// The dataset.
        path: PathBuf,
    },
    /// The motion model starts from bodies, and there are none.
    #[error(
        "dataset '{path}' has no bodies, which `motion = \"bodies\"` starts from; find them with `erfgs dataset bodies {path}`, or train with --motion free-time"
    )]
    NoBodies {
        /// The dataset.
        path: PathBuf,
    },
    /// A body is named that is none of the dataset's.
    #[error("`{setting}` names '{name}', and no body of dataset '{path}' is called that; they are called {known}")]
    UnknownBody {
        /// The setting.
        setting: &'static str,
        /// The name.
        name: String,
        /// The dataset.
        path: PathBuf,
        /// The bodies that there are.
        known: String,
    },
    /// No body is left to carry anything.
    #[error("`bodies.free` names all bodies of dataset '{path}'; train with --motion free-time")]
    AllFree {
        /// The dataset.
        path: PathBuf,
    },
    /// This machine has not the memory that the cameras take.
    #[error(
        "training on dataset '{path}' is too much for this machine: {shortage}. Camera '{camera}' takes most, with its {} x {} pixels; make the dataset smaller (`erfgs dataset import --scale`), leave cameras out, or train on a larger machine",
        size[0], size[1]
    )]
    Memory {
        /// The dataset.
        path: PathBuf,
        /// The camera that takes most.
        camera: String,
        /// Its width and height.
        size: [u32; 2],
        /// What is needed and what there is.
        shortage: erfgs_base::memory::Shortage,
    },
    /// The numbers of the trainer cannot tell places apart so far away.
    #[error(
        "the cameras of dataset '{path}' stand {away:.0} m from the origin, where single precision tells places {apart:.1e} m apart: {pixels:.1} pixels of camera '{camera}'; subtract one offset from all poses and points, so that the origin lies in the scene"
    )]
    FarAway {
        /// The dataset.
        path: PathBuf,
        /// The camera that sees the least distances.
        camera: String,
        /// How far from the origin it stands, metres.
        away: f64,
        /// The distance of neighbouring numbers there, metres.
        apart: f64,
        /// That in pixels, where the scene is.
        pixels: f64,
    },
    /// The system has no threads left for reading frames while others are trained on.
    #[error("cannot start the threads that read frames: {source}; close other programs, or raise the limit of threads")]
    Threads {
        /// Why.
        source: rayon::ThreadPoolBuildError,
    },
    /// The file that events lie in, where memory is not meant for them, cannot be written or read.
    #[error(
        "cannot keep events in a file in '{path}': {source}; make room there, or let them stay in memory with a larger --memory"
    )]
    Scratch {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
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
}

impl TrainFrame {
    /// The instant that the frame stands for, in [0, 1]: that at a `share` of its exposure, or its label.
    #[must_use]
    pub fn instant(&self, share: Option<f32>) -> f64 {
        let [start, end] = self.exposure;
        share.map_or(self.t01, |share| start + (end - start) * f64::from(share))
    }
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
    /// Their pixels, in their order.
    pub pictures: Pictures,
    /// The event cameras.
    pub events: Vec<EventView>,
    /// Whether their events lie in files, as memory is not meant for them.
    pub events_filed: bool,
    /// The bins that events are counted in.
    pub bins: Bins,
    /// How the light flickers, where bins are from peak to peak.
    pub flicker: Option<Flicker>,
    /// Frames of held-out cameras.
    pub held_out: Vec<HeldOutFrame>,
    /// The initial cloud.
    pub points: Vec<Point>,
    /// For each point the instant, in [0, 1], at which it is known to have been there on something that moves; empty where
    /// nothing is known of any.
    pub point_times: Vec<Option<f64>>,
    /// The instants that training frames stand for, each once, ascending, in [0, 1].
    pub frame_times: Vec<f64>,
    /// 1.1 times the largest distance of a training camera from their mean, or, of cameras at one point, the median distance
    /// of the initial points, metres: the unit of learning rates and sizes.
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

    /// An instant in [0, 1] in nanoseconds.
    #[must_use]
    pub fn from_unit(&self, t01: f64) -> i64 {
        let [start, end] = self.dataset.manifest.span_ns;
        start + ((end - start) as f64 * t01).round() as i64
    }

    /// The training frames of a view, as indices into [`Scene::frames`].
    pub(crate) fn frames_of(&self, view: usize) -> impl Iterator<Item = usize> {
        (0..self.frames.len()).filter(move |&index| self.frames[index].view == view)
    }

    /// Whether a view has training frames.
    pub(crate) fn has_frames(&self, view: usize) -> bool {
        self.views[view].split == Split::Train && !self.dataset.manifest.cameras[view].frames.is_empty()
    }

    /// How many intervals between the frames of a camera the recording spans: the unit of time of trajectories.
    #[must_use]
    pub fn intervals(&self) -> f64 {
        let mut steps: Vec<f64> = Vec::new();
        for view in 0..self.views.len() {
            let times: Vec<f64> = self.frames_of(view).map(|index| self.frames[index].t01).collect();
            steps.extend(times.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0));
        }
        median(steps).map_or(1.0, |step| 1.0 / step.clamp(1e-6, 1.0))
    }

    /// The points of the initial cloud that are not known to move.
    #[must_use]
    pub fn still_points(&self) -> Vec<Point> {
        let moves = |index: usize| self.point_times.get(index).is_some_and(Option::is_some);
        self.points.iter().enumerate().filter(|(index, _)| !moves(*index)).map(|(_, point)| *point).collect()
    }

    /// What recordings are to bodies.
    #[must_use]
    pub fn recording(&self) -> Recording {
        Recording { span_ns: self.dataset.manifest.span_ns, intervals: self.intervals() }
    }

    /// The bodies of the dataset that carry Gaussians.
    ///
    /// # Errors
    /// [`SceneError::NoBodies`] where none were found, [`SceneError::UnknownBody`] where the configuration names one that is not there,
    /// [`SceneError::AllFree`] where it names all, [`SceneError::Dataset`] where their file is damaged.
    pub fn carrying(&self, config: &Config) -> Result<Vec<Body>, SceneError> {
        let bodies = self.dataset.read_bodies()?.map(|file| file.bodies).unwrap_or_default();
        if bodies.is_empty() {
            return Err(SceneError::NoBodies { path: self.dataset.root.clone() });
        }
        let free = &config.bodies.free;
        for (setting, names) in [("bodies.free", free), ("bodies.bend", &config.bodies.bend)] {
            if let Some(name) = names.iter().find(|name| bodies.iter().all(|body| body.name != **name)) {
                let (name, path) = (name.clone(), self.dataset.root.clone());
                let known = bodies.iter().map(|body| body.name.as_str()).collect::<Vec<_>>().join(", ");
                return Err(SceneError::UnknownBody { setting, name, path, known });
            }
        }
        let carrying: Vec<Body> = bodies.into_iter().filter(|body| !free.contains(&body.name)).collect();
        if carrying.is_empty() {
            return Err(SceneError::AllFree { path: self.dataset.root.clone() });
        }
        Ok(carrying)
    }

    /// Where the bodies of the dataset start from.
    ///
    /// # Errors
    /// As [`Scene::carrying`].
    pub fn bodies(&self, config: &Config) -> Result<Start, SceneError> {
        let apart_px = f64::from(config.bodies.spacing_px);
        let thinned = |piece: Piece| {
            let apart_m = self.pixels_a_metre(&piece.body).map_or(0.0, |pixels| apart_px / pixels);
            Piece { body: thin(piece.body, apart_m), ..piece }
        };
        let moving = if config.bodies.bend.is_empty() { Vec::new() } else { self.moving_points() };
        let pieces = pieces(self.carrying(config)?, &config.bodies, &moving, self.recording());
        let pieces: Vec<Piece> = pieces.into_iter().map(thinned).collect();
        Ok(from_bodies(&pieces, self.recording(), config.sh.max_degree, &config.bodies, &config.free_time))
    }

    /// How many pixels a metre is wide at the places of a body: the median over cameras with frames that have it in view, where the
    /// dataset has them. A run that goes on with poses that it learned starts from the same points.
    fn pixels_a_metre(&self, body: &Body) -> Option<f64> {
        /// Places that are looked at.
        const PLACES: usize = 32;
        let middle = body.points.iter().map(|point| DVec3::from(point.position_m)).sum::<DVec3>()
            / body.points.len().max(1) as f64;
        let every = body.poses.len().div_ceil(PLACES).max(1);
        let places = body.poses.iter().step_by(every).map(|pose| pose.place(middle).as_vec3().to_array());
        let seen = places.flat_map(|place| {
            let cameras = &self.dataset.manifest.cameras;
            let as_given = move |view: usize| self.views[view].view.placed(&cameras[view].world_to_camera);
            let views = (0..self.views.len()).filter(|&view| self.has_frames(view)).map(as_given);
            views.filter(move |view| project(view, &place).is_some()).map(move |view| {
                let [.., depth_m] = view.to_camera(&place);
                f64::from(view.fx / depth_m)
            })
        });
        median(seen.filter(|pixels| pixels.is_finite()).collect())
    }

    /// The points that are known to move, and when each was where it is, in [0, 1].
    #[must_use]
    pub fn moving_points(&self) -> Vec<(Point, f64)> {
        self.points.iter().zip(&self.point_times).filter_map(|(point, time)| Some((*point, (*time)?))).collect()
    }

    /// How long frames are exposed, of the whole recording: the median.
    #[must_use]
    pub fn exposure(&self) -> f64 {
        median(self.frames.iter().map(|frame| frame.exposure[1] - frame.exposure[0]).collect()).unwrap_or(0.0)
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
