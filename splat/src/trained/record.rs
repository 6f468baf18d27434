//! What a training notes for whoever draws its run.

use erfgs_scene::Modality;
use serde::{Deserialize, Serialize};

use crate::{
    motion::MotionPlan,
    near::near_plane_beside,
    raster::{LOW_PASS, RenderOptions, View},
};

/// The recording that a run was trained on, and how its Gaussians are drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// First and last instant, session nanoseconds.
    pub span_ns: [i64; 2],
    /// RGB intervals in the recording.
    pub intervals: f64,
    /// How the Gaussians are drawn.
    pub drawing: Drawing,
    /// How they move.
    pub motion: MotionPlan,
    /// How many vectors hold what all Gaussians share of the motion.
    pub shared_vectors: usize,
    /// The cameras.
    pub cameras: Vec<RecordedCamera>,
    /// When events came.
    pub events: RecordedEvents,
}

/// How the Gaussians are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawing {
    /// Colour behind everything.
    pub background: [f32; 3],
    /// SH degree in use.
    pub sh_degree: u32,
    /// The least near plane, metres.
    pub near_m: f32,
    /// The share of the depth of the nearest points at which it lies.
    pub near_share: f32,
    /// Standard deviations of a Gaussian that must lie in front of a camera.
    pub near_sigmas: f32,
}

/// A camera of the recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedCamera {
    /// Its name.
    pub name: String,
    /// Whether it was held out.
    pub held_out: bool,
    /// What it recorded.
    pub modality: Modality,
    /// Image size, intrinsics, and the pose that the training found.
    pub view: View,
    /// Time, start and end of exposure of each frame, session nanoseconds.
    pub frames_ns: Vec<[i64; 3]>,
}

/// When events came.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedEvents {
    /// Edges of bins, in [0, 1].
    pub edges: Vec<f64>,
    /// Events in each bin, over all cameras.
    pub counts: Vec<f64>,
}

impl RecordedCamera {
    /// Whether frames of it were trained on.
    #[must_use]
    pub fn is_trained(&self) -> bool {
        !self.held_out && !self.frames_ns.is_empty()
    }
}

impl Record {
    /// How long the recording is, seconds.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        let [start, end] = self.span_ns;
        1e-9 * end.saturating_sub(start) as f64
    }

    /// An instant in [0, 1], so many seconds after the recording's start; the nearest that the recording has.
    #[must_use]
    pub fn share(&self, seconds: f64) -> f64 {
        let length = self.seconds();
        if length > 0.0 { (seconds / length).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Session nanoseconds in [0, 1].
    #[must_use]
    pub fn to_unit(&self, t_ns: i64) -> f64 {
        let [start, end] = self.span_ns;
        if end > start { t_ns.saturating_sub(start) as f64 / end.saturating_sub(start) as f64 } else { 0.0 }
    }

    /// An instant in [0, 1] in session nanoseconds.
    #[must_use]
    pub fn from_unit(&self, t01: f64) -> i64 {
        let [start, end] = self.span_ns;
        start.saturating_add((end.saturating_sub(start) as f64 * t01).round() as i64)
    }

    /// The near plane of `view`, metres, where the training began with these `points`: [`near_plane_beside`].
    #[must_use]
    pub fn near(&self, points: &[[f32; 3]], view: &View) -> f32 {
        let Drawing { near_m, near_share, .. } = self.drawing;
        let trained = self.cameras.iter().filter(|camera| camera.is_trained()).map(|camera| &camera.view);
        near_plane_beside(trained, points.iter(), view, near_share, near_m)
    }

    /// How to draw `view`.
    #[must_use]
    pub fn options(&self, points: &[[f32; 3]], view: &View) -> RenderOptions {
        let Drawing { background, sh_degree, near_sigmas, .. } = self.drawing;
        let near = self.near(points, view);
        let low_pass = low_pass(self.cameras.iter().map(|camera| &camera.view), view);
        RenderOptions { background, sh_degree, near, near_sigmas, low_pass, depth: true, ..RenderOptions::default() }
    }
}

/// The low pass of a picture that may be larger than those of the cameras.
#[must_use]
pub fn low_pass<'a>(cameras: impl Iterator<Item = &'a View>, view: &View) -> f32 {
    let focal = cameras.map(|own| own.fx).fold(0.0, f32::max);
    let larger = if focal > 0.0 { (view.fx / focal).max(1.0) } else { 1.0 };
    LOW_PASS * larger * larger
}
