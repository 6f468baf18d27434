//! Bundle adjustment: cameras and what they saw, in one least-squares problem.
//!
//! One solver serves every kind of calibration. What the cameras saw are *placements*: a board held somewhere, a wand, or
//! a single point. A placement has few parameters of its own and is seen by a few cameras, so that the normal equations
//! are solved on the cameras alone (the Schur complement, `reduced.rs`), by Levenberg's and Marquardt's damped steps
//! (`solve.rs`). The inverse of the same matrix at the solution is the covariance (`uncertainty.rs`), and where it has no
//! inverse the parameters that the observations leave open are named. Where errors are shared by neighbours, `clusters.rs`
//! finds the covariance from how much clusters of them differ. A target with more than one side has each further one where a
//! transformation says that all its placements share (`side.rs`); it is solved for with the cameras.
//!
//! Gauge: the world is where the fixed pose of a reference camera says. Lengths come from boards and wands, or, with points
//! alone, from a [`Prior::Distance`].

pub mod clusters;
pub mod jackknife;
mod normal;
mod parameter;
mod reduced;
mod residual;
mod rig;
mod side;
mod solve;
#[cfg(test)]
mod tests;
mod ties;
mod uncertainty;

use erfgs_scene::{Intrinsics, Pose};
use glam::{DVec2, DVec3};

pub use parameter::{Parameter, free_lens};
pub use reduced::Method;
pub use side::Side;
pub use solve::{Loss, Options, Solution, Step, Stop};
pub use uncertainty::{CameraUncertainty, OpenDirection, SideUncertainty, Uncertainty};

/// One camera of a rig that stands still.
#[derive(Clone, Debug, PartialEq)]
pub struct BundleCamera {
    /// Name, for messages.
    pub name: String,
    /// Lens and sensor.
    pub intrinsics: Intrinsics,
    /// World-to-camera pose.
    pub pose: Pose,
    /// What to add to the camera's times to get the rig's, seconds.
    pub time_offset_s: f64,
    /// What the solver may change.
    pub free: Vec<Parameter>,
}

/// Something that was held before the cameras once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placement {
    /// A rigid target: the pose takes the target's points to the world.
    Board(Pose),
    /// A stick: a point lies `offset` metres from `middle` along `direction`.
    Wand {
        /// Where offset 0 is, world, metres.
        middle: DVec3,
        /// Direction of growing offsets, length 1.
        direction: DVec3,
    },
    /// A point in the world, metres.
    Point(DVec3),
    /// Features whose places in the world are known: those are their places on the target.
    Fixed,
}

/// One feature of one placement in one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index of the camera.
    pub camera: usize,
    /// Index of the placement.
    pub placement: usize,
    /// Where the feature is on its target, metres; on a wand x is the offset, for a point it has no meaning. In the frame of
    /// `side`, if there is one.
    pub on_target: DVec3,
    /// Index of the side of the target that it is on; `None` where the placement itself says where that side is.
    pub side: Option<usize>,
    /// Where it was seen, pixels.
    pub pixel: DVec2,
    /// Standard deviation of `pixel` in either direction, pixels.
    pub sigma_px: f64,
    /// How fast it moved across the image, pixels per second; ties the camera's time offset to what is seen.
    pub velocity: DVec2,
    /// Whether it takes part; outliers are kept and marked.
    pub used: bool,
}

/// Something known beforehand.
#[derive(Clone, Debug, PartialEq)]
pub enum Prior {
    /// An intrinsic parameter or time offset is `value`, up to `sigma`.
    Value {
        /// Index of the camera.
        camera: usize,
        /// The parameter; poses have no prior.
        parameter: Parameter,
        /// What it is thought to be.
        value: f64,
        /// Standard deviation.
        sigma: f64,
    },
    /// The centres of two cameras are `metres` apart, up to `sigma`.
    Distance {
        /// Indices of the cameras.
        cameras: [usize; 2],
        /// The distance, metres.
        metres: f64,
        /// Standard deviation, metres.
        sigma: f64,
    },
}

/// A problem, and after [`Bundle::solve`] its solution.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bundle {
    /// The cameras, which observations name by index.
    pub cameras: Vec<BundleCamera>,
    /// What was held before them, which observations name by index.
    pub placements: Vec<Placement>,
    /// Further sides of what was held before them, which observations name by index.
    pub sides: Vec<Side>,
    /// What was seen, in any order.
    pub observations: Vec<Observation>,
    /// What is known beforehand.
    pub priors: Vec<Prior>,
}

/// A problem that cannot be set up.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BundleError {
    /// An index, a pixel or a sigma that makes no sense.
    #[error("observation {index}: {what}")]
    Observation {
        /// Its number.
        index: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// A camera that cannot be projected with.
    #[error("camera {camera}: {what}")]
    Camera {
        /// Its name.
        camera: String,
        /// What is wrong.
        what: &'static str,
    },
    /// A side of a target that is nowhere.
    #[error("{side}: {what}")]
    Side {
        /// Its name.
        side: String,
        /// What is wrong.
        what: &'static str,
    },
    /// A prior that makes no sense.
    #[error("prior {index}: {what}")]
    Prior {
        /// Its number.
        index: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// Nothing to solve.
    #[error("there is nothing to adjust: no observation takes part, or no parameter is free")]
    Empty,
}

impl Placement {
    /// Number of parameters.
    #[must_use]
    pub fn parameters(&self) -> usize {
        match self {
            Self::Board(_) => 6,
            Self::Wand { .. } => 5,
            Self::Point(_) => 3,
            Self::Fixed => 0,
        }
    }

    /// Where a feature of the target is in the world.
    #[must_use]
    pub fn world(&self, on_target: DVec3) -> DVec3 {
        match self {
            Self::Board(pose) => pose.transform(on_target),
            Self::Wand { middle, direction } => *middle + *direction * on_target.x,
            Self::Point(point) => *point,
            Self::Fixed => on_target,
        }
    }

    /// How a feature moves in the world if it moves on its target like this.
    fn direction(&self, on_target: DVec3) -> DVec3 {
        match self {
            Self::Board(pose) => pose.rotation * on_target,
            Self::Wand { direction, .. } => *direction * on_target.x,
            Self::Point(_) => DVec3::ZERO,
            Self::Fixed => on_target,
        }
    }
}

impl Bundle {
    /// Predicted minus observed position, pixels; `None` where the camera cannot see the feature.
    #[must_use]
    pub fn residual_px(&self, observation: &Observation) -> Option<DVec2> {
        let camera = &self.cameras[observation.camera];
        let world = self.placements[observation.placement].world(self.on_placement(observation));
        let seen = camera.intrinsics.project(camera.pose.transform(world))?;
        Some(seen - observation.pixel + observation.velocity * camera.time_offset_s)
    }

    /// Where a feature is on what was held, in the frame that its placement takes to the world.
    fn on_placement(&self, observation: &Observation) -> DVec3 {
        let on_target = observation.on_target;
        observation.side.map_or(on_target, |side| self.sides[side].pose.transform(on_target))
    }

    /// Root mean square of the residuals' lengths, over the observations of `camera` (or all) that take part, pixels, and
    /// their number. What a camera cannot see is left out.
    #[must_use]
    pub fn rms_px(&self, camera: Option<usize>) -> (f64, usize) {
        let chosen = self.observations.iter().filter(|o| o.used && camera.is_none_or(|camera| o.camera == camera));
        let (mut sum, mut count) = (0.0, 0);
        for residual in chosen.filter_map(|observation| self.residual_px(observation)) {
            sum += residual.length_squared();
            count += 1;
        }
        (if count > 0 { (sum / count as f64).sqrt() } else { 0.0 }, count)
    }

    /// Marks as outliers what lies farther than `limit` standard deviations (and at least `floor_px`) from where it should,
    /// and what no camera can see there; takes back what no longer does. The number of outliers.
    pub fn mark_outliers(&mut self, limit: f64, floor_px: f64) -> usize {
        let used: Vec<bool> = self
            .observations
            .iter()
            .map(|o| self.residual_px(o).is_some_and(|r| r.length() <= (limit * o.sigma_px).max(floor_px)))
            .collect();
        for (observation, used) in self.observations.iter_mut().zip(&used) {
            observation.used = *used;
        }
        used.iter().filter(|used| !**used).count()
    }

    fn check(&self) -> Result<(), BundleError> {
        for camera in &self.cameras {
            let error = |what| BundleError::Camera { camera: camera.name.clone(), what };
            let i = &camera.intrinsics;
            if !(i.fx > 0.0
                && i.fy > 0.0
                && [i.fx, i.fy, i.cx, i.cy, camera.time_offset_s].iter().all(|v| v.is_finite()))
            {
                return Err(error("its intrinsics are no finite numbers, or a focal length is not positive"));
            }
            if !camera.pose.is_finite() {
                return Err(error("its pose has a number that is not finite"));
            }
            if camera.free.len() > parameter::PARAMETERS {
                return Err(error("it has more free parameters than there are"));
            }
        }
        for side in &self.sides {
            if !(side.pose.is_finite() && side.middle.is_finite()) {
                return Err(BundleError::Side {
                    side: side.name.clone(),
                    what: "its pose has a number that is not finite",
                });
            }
        }
        for (index, o) in self.observations.iter().enumerate() {
            let error = |what| Err(BundleError::Observation { index, what });
            if o.side.is_some_and(|side| side >= self.sides.len()) {
                return error("it names a side that does not exist");
            }
            if o.camera >= self.cameras.len() || o.placement >= self.placements.len() {
                return error("it names a camera or placement that does not exist");
            }
            if !(o.pixel.is_finite() && o.on_target.is_finite() && o.velocity.is_finite()) {
                return error("a coordinate is not finite");
            }
            if !(o.sigma_px > 0.0 && o.sigma_px.is_finite()) {
                return error("its standard deviation is not positive");
            }
        }
        for (index, prior) in self.priors.iter().enumerate() {
            let error = |what| Err(BundleError::Prior { index, what });
            let (cameras, value, sigma) = match prior {
                Prior::Value { camera, parameter, value, sigma } => {
                    if matches!(parameter, Parameter::Rotation(_) | Parameter::Translation(_)) {
                        return error("a pose has no prior");
                    }
                    ([*camera; 2], value, sigma)
                }
                Prior::Distance { cameras, metres, sigma } => (*cameras, metres, sigma),
            };
            if cameras.iter().any(|camera| *camera >= self.cameras.len()) {
                return error("it names a camera that does not exist");
            }
            if !(value.is_finite() && *sigma > 0.0 && sigma.is_finite()) {
                return error("its value is not finite or its standard deviation is not positive");
            }
        }
        Ok(())
    }
}
