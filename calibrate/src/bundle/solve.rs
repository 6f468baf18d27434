//! Levenberg's and Marquardt's iteration.

use std::{mem, time::Instant};

use super::{
    Bundle, BundleCamera, BundleError, Placement, Side,
    clusters::gradient_variance,
    jackknife::variances,
    normal::{Layout, cost, linearise},
    reduced::{Method, step},
    uncertainty::{Errors, Uncertainty, uncertainty},
};

/// What a residual costs, by its square in standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Loss {
    /// Its square.
    #[default]
    Squared,
    /// Grows with the logarithm beyond so many standard deviations: outliers lose their pull.
    Cauchy(f64),
}

impl Loss {
    pub(super) fn value(self, squared: f64) -> f64 {
        match self {
            Self::Squared => squared,
            Self::Cauchy(width) => width * width * (squared / (width * width)).ln_1p(),
        }
    }

    pub(super) fn weight(self, squared: f64) -> f64 {
        match self {
            Self::Squared => 1.0,
            Self::Cauchy(width) => 1.0 / (1.0 + squared / (width * width)),
        }
    }
}

/// How a bundle is solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// What a residual costs.
    pub loss: Loss,
    /// Steps tried at most.
    pub iterations: usize,
    /// A step that lowers the cost by less than this share ends the iteration.
    pub tolerance: f64,
    /// How the cameras' system is solved.
    pub method: Method,
}

impl Default for Options {
    fn default() -> Self {
        Self { loss: Loss::Squared, iterations: 100, tolerance: 1e-8, method: Method::Auto }
    }
}

/// One try, for error against run time.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Step {
    /// Seconds since the start.
    pub seconds: f64,
    /// Half the sum of squares in standard deviations, or of what the loss makes of them, after the step.
    pub cost: f64,
    /// Root mean square residual after the step, pixels.
    pub rms_px: f64,
    /// Damping.
    pub lambda: f64,
    /// Whether the step was taken.
    pub taken: bool,
}

/// Why the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// Steps no longer change the cost.
    Converged,
    /// The limit of [`Options::iterations`].
    Iterations,
    /// No step lowers the cost, however short.
    Stalled,
}

/// How it went.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The start and every try.
    pub steps: Vec<Step>,
    /// Why it ended.
    pub stop: Stop,
    /// How the cameras' system was solved.
    pub method: Method,
    /// Number of free parameters: of the cameras and of targets' sides, and of the placements.
    pub parameters: [usize; 2],
    /// Number of observations that took part.
    pub observations: usize,
}

impl Bundle {
    /// Changes the free parameters and the placements so that the cost is least.
    ///
    /// # Errors
    /// If the problem cannot be set up; a problem that does not converge or leaves parameters open is no error here, see
    /// [`Solution::stop`] and [`Bundle::uncertainty`].
    pub fn solve(&mut self, options: &Options) -> Result<Solution, BundleError> {
        self.check()?;
        let layout = Layout::new(self);
        if layout.observations == 0 || layout.shared + layout.private == 0 {
            return Err(BundleError::Empty);
        }
        let since = Instant::now();
        let (mut lambda, mut growth) = (1e-4, 2.0);
        let mut normal = linearise(self, options.loss, &layout);
        let mut steps = vec![Step {
            seconds: since.elapsed().as_secs_f64(),
            cost: normal.cost,
            rms_px: normal.rms_px,
            lambda,
            taken: true,
        }];
        let mut stop = Stop::Iterations;
        for _ in 0..options.iterations {
            // The state that the step leads to takes the place of the one that it leads from, until it turns out to be no better.
            let tried = step(&normal, &layout, lambda, options.method).map(|damped| {
                let mut before = self.moved(&layout, &damped);
                self.swap(&mut before);
                (before, damped.predicted, cost(self, options.loss, &layout))
            });
            let gain = tried.as_ref().map_or(-1.0, |(_, predicted, (cost, _))| {
                let gained = normal.cost - cost;
                if gained.is_finite() && *predicted > 0.0 { gained / predicted } else { -1.0 }
            });
            let (cost, rms_px) = tried.as_ref().map_or((f64::INFINITY, f64::INFINITY), |(.., found)| *found);
            let taken = gain > 0.0;
            steps.push(Step { seconds: since.elapsed().as_secs_f64(), cost, rms_px, lambda, taken });
            let small = |change: f64| change <= options.tolerance * normal.cost.max(f64::MIN_POSITIVE);
            match tried {
                Some(_) if taken => {
                    if small(normal.cost - cost) {
                        stop = Stop::Converged;
                        break;
                    }
                    normal = linearise(self, options.loss, &layout);
                    // Nielsen's rule: the better the model foretold the cost, the less damping.
                    lambda = (lambda * (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-15);
                    growth = 2.0;
                }
                tried => {
                    let promised = tried.map(|(mut before, predicted, _)| {
                        self.swap(&mut before);
                        predicted
                    });
                    // The model promises nothing either: rounding decides, and this is as far as it goes.
                    if promised.is_some_and(|predicted| small(predicted.abs())) {
                        stop = Stop::Converged;
                        break;
                    }
                    lambda *= growth;
                    growth *= 2.0;
                    if lambda > 1e20 {
                        stop = Stop::Stalled;
                        break;
                    }
                }
            }
        }
        Ok(Solution {
            steps,
            stop,
            method: options.method.for_size(layout.shared),
            parameters: [layout.shared, layout.private],
            observations: layout.observations,
        })
    }

    /// How well the free parameters are determined at the present state, with the weights of `loss`.
    ///
    /// # Errors
    /// If the problem cannot be set up.
    pub fn uncertainty(&self, loss: Loss) -> Result<Uncertainty, BundleError> {
        self.check()?;
        let layout = Layout::new(self);
        if layout.observations == 0 {
            return Err(BundleError::Empty);
        }
        Ok(uncertainty(self, &layout, &linearise(self, loss, &layout), &Errors::Own))
    }

    /// The same, for errors that placements of one cluster share: `clusters` has a number for each placement.
    ///
    /// # Errors
    /// If the problem cannot be set up.
    ///
    /// # Panics
    /// If there are fewer entries than placements.
    pub fn uncertainty_of_clusters(&self, loss: Loss, clusters: &[usize]) -> Result<Uncertainty, BundleError> {
        self.check()?;
        assert!(clusters.len() >= self.placements.len(), "each placement needs a cluster");
        let layout = Layout::new(self);
        if layout.observations == 0 {
            return Err(BundleError::Empty);
        }
        let between = gradient_variance(self, &layout, loss, clusters);
        Ok(uncertainty(self, &layout, &linearise(self, loss, &layout), &Errors::Shared(&between)))
    }

    /// The same as [`Bundle::uncertainty`], but no sigma is smaller than the change from leaving a group of placements out:
    /// `groups` has a number for each placement. Errors that all corners of a view share (a bent board, cameras that are not
    /// quite simultaneous) show there, and hardly in residuals.
    ///
    /// # Errors
    /// If the problem cannot be set up.
    ///
    /// # Panics
    /// If there are fewer entries than placements.
    pub fn uncertainty_of_groups(&self, loss: Loss, groups: &[usize]) -> Result<Uncertainty, BundleError> {
        self.check()?;
        assert!(groups.len() >= self.placements.len(), "each placement needs a group");
        let layout = Layout::new(self);
        if layout.observations == 0 {
            return Err(BundleError::Empty);
        }
        let normal = linearise(self, loss, &layout);
        let errors = variances(self, &normal, loss, groups);
        Ok(uncertainty(self, &layout, &normal, &errors.as_ref().map_or(Errors::Own, Errors::AtLeast)))
    }

    fn moved(&self, layout: &Layout, step: &super::reduced::Damped) -> State {
        let cameras = self.cameras.iter().zip(&layout.columns);
        let placements = self.placements.iter().zip(&step.placements);
        let sides = self.sides.iter().zip(layout.of_sides());
        State {
            cameras: cameras.map(|(camera, columns)| camera.moved(&step.shared.as_slice()[columns.clone()])).collect(),
            placements: placements.map(|(placement, own)| placement.moved(own.as_slice())).collect(),
            sides: sides.map(|(side, columns)| side.moved(&step.shared.as_slice()[columns.clone()])).collect(),
        }
    }

    fn swap(&mut self, state: &mut State) {
        mem::swap(&mut self.cameras, &mut state.cameras);
        mem::swap(&mut self.placements, &mut state.placements);
        mem::swap(&mut self.sides, &mut state.sides);
    }
}

/// What a step changes of a bundle.
struct State {
    cameras: Vec<BundleCamera>,
    placements: Vec<Placement>,
    sides: Vec<Side>,
}
