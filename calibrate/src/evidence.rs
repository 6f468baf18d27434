//! What a calibration saw and how it went: the raw material of the report.

use glam::DVec2;

use crate::bundle::{Bundle, Solution, Step};

/// One observation and how far it is from where the solution puts it.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Number of the placement (board or wand position, or point).
    pub placement: usize,
    /// Where it was seen, pixels.
    pub pixel: DVec2,
    /// Predicted minus seen, pixels; `None` where the solution cannot see it at all.
    pub residual: Option<DVec2>,
    /// Whether it took part.
    pub used: bool,
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
    /// Lengths that took no part.
    pub held_out: Vec<HeldOut>,
    /// Tables of the method's own: a title, a head, rows.
    pub tables: Vec<Table>,
}

/// A table of the report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Title.
    pub title: String,
    /// A sentence below it.
    pub note: String,
    /// Column heads.
    pub head: Vec<String>,
    /// Rows.
    pub rows: Vec<Vec<String>>,
}

impl Evidence {
    /// Adds a pass.
    pub fn pass(&mut self, name: impl Into<String>, solution: &Solution) {
        self.passes.push(Pass { name: name.into(), steps: solution.steps.clone() });
    }

    /// Takes the residuals of a solved bundle.
    pub fn observe(&mut self, bundle: &Bundle) {
        let of = |o: &crate::bundle::Observation| Residual {
            camera: o.camera,
            placement: o.placement,
            pixel: o.pixel,
            residual: bundle.residual_px(o),
            used: o.used,
        };
        self.residuals = bundle.observations.iter().map(of).collect();
    }
}
