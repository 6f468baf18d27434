//! What a calibration saw and how it went: the raw material of the report.

use erfgs_scene::{ImageRgb8, image::Resample};
use glam::{DVec2, DVec3};

use crate::bundle::{Bundle, Solution, Step};

/// One observation and how far it is from where the solution puts it.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Number of the placement (board or wand position, or point).
    pub placement: usize,
    /// Where it is on what was held, metres; together with the placement and the side, it tells which feature of the scene it is.
    pub on_target: DVec3,
    /// The side of it where it is not the first one, in whose frame `on_target` then is.
    pub side: Option<usize>,
    /// Where it was seen, pixels.
    pub pixel: DVec2,
    /// Where it was at the placement's instant, if the camera's time offset is as estimated, pixels.
    pub at_instant: DVec2,
    /// Predicted minus seen, pixels; `None` where the solution cannot see it at all.
    pub residual: Option<DVec2>,
    /// Whether it took part.
    pub used: bool,
}

/// When something was held before the cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// What the instant is called in the recording.
    pub name: String,
    /// When it was, on the recording's clock, where that is known.
    pub t_ns: Option<i64>,
}

/// A picture of what a camera saw, for the report.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Index of the camera in the rig.
    pub camera: usize,
    /// The placement that it shows; `None` where all were seen at one instant.
    pub placement: Option<usize>,
    /// The picture, reduced.
    pub image: ImageRgb8,
    /// What was found in it, as far as it is not where the residuals say: on the target (metres), and in the camera's image
    /// (pixels).
    pub found: Vec<(DVec3, DVec2)>,
}

/// A known length that took no part, measured with the solution.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldOut {
    /// What was measured, such as `outer LEDs`.
    pub what: String,
    /// What it is, metres.
    pub known_m: f64,
    /// What it was found to be, metres.
    pub found_m: f64,
}

/// A pass of the solver.
#[derive(Clone, Debug, PartialEq)]
pub struct Pass {
    /// What it solved, such as `intrinsics of left` or `all cameras`.
    pub name: String,
    /// Error against run time.
    pub steps: Vec<Step>,
}

/// What a calibration saw and how it went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Every observation of the last pass.
    pub residuals: Vec<Residual>,
    /// The passes, in order.
    pub passes: Vec<Pass>,
    /// When each placement was seen; empty where all were seen at one instant.
    pub moments: Vec<Moment>,
    /// Pictures, one of a camera at most.
    pub pictures: Vec<Picture>,
    /// Lengths that took no part.
    pub held_out: Vec<HeldOut>,
    /// Tables of the method's own: a title, a head, rows.
    pub tables: Vec<Table>,
    /// Outlines of what was held before the cameras, in the world, for the picture of the rig.
    pub outlines: Vec<[DVec3; 4]>,
}

/// A table of the report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Heading of the section.
    pub title: String,
    /// A sentence below it.
    pub note: String,
    /// Column heads.
    pub head: Vec<String>,
    /// Cells of each row, as many as heads.
    pub rows: Vec<Vec<String>>,
}

impl Picture {
    /// Wider pictures are reduced to this, pixels: a report holds one or two of each camera.
    pub const WIDEST: u32 = 640;

    /// A picture of a camera, reduced.
    #[must_use]
    pub fn new(camera: usize, placement: Option<usize>, image: &ImageRgb8) -> Self {
        let width = image.width.min(Self::WIDEST);
        let height = (u64::from(image.height) * u64::from(width)).div_ceil(u64::from(image.width.max(1))).max(1) as u32;
        Self { camera, placement, image: image.resized(width, height, Resample::Area), found: Vec::new() }
    }
}

impl Evidence {
    /// Adds a pass.
    pub fn pass(&mut self, name: impl Into<String>, solution: &Solution) {
        self.passes.push(Pass { name: name.into(), steps: solution.steps.clone() });
    }

    /// Takes the residuals of a solved bundle.
    pub fn observe(&mut self, bundle: &Bundle) {
        self.residuals = residuals(bundle);
    }

    /// Adds the residuals of a camera that was solved by itself, which is camera `camera` of the rig, and when it saw what.
    pub(crate) fn observe_also(&mut self, bundle: &Bundle, camera: usize, moments: &[Moment]) {
        let before = self.moments.len();
        let own = residuals(bundle).into_iter();
        self.residuals.extend(own.map(|own| Residual { camera, placement: before + own.placement, ..own }));
        self.moments.extend_from_slice(moments);
    }
}

fn residuals(bundle: &Bundle) -> Vec<Residual> {
    let of = |o: &crate::bundle::Observation| Residual {
        camera: o.camera,
        placement: o.placement,
        on_target: o.on_target,
        side: o.side,
        pixel: o.pixel,
        at_instant: o.pixel - o.velocity * bundle.cameras[o.camera].time_offset_s,
        residual: bundle.residual_px(o),
        used: o.used,
    };
    bundle.observations.iter().map(of).collect()
}
