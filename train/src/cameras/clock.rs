//! The clocks of the training cameras, learned beside the scene.
//!
//! A camera without a trigger tells when it exposed its frames to some milliseconds, in which what is fast goes some pixels: what cameras do
//! not agree on is smeared. Each camera that takes frames gets a time of its own that its frames were exposed later than they say, by the
//! gradients of what moves. No frame tells a scene that is later from cameras that are, and events too weakly: what all cameras have in
//! common is taken from them after each step. An event camera without frames gets such a time, too: its pixels answer late in dim light, and
//! its clock may be another. The frames say when the scene is, so that its time is its own.

use serde::{Deserialize, Serialize};

use super::{CameraState, Quantity, Rule, Summed, pose::within};
use erfgs_splat::motion::ClockRow;

/// A step is no longer than this share of a camera's standard deviation.
const STEP: f64 = 0.2;
/// No clock counts as surer than this, RGB intervals.
const CERTAIN: f64 = 1e-6;

/// How the clocks of the cameras are learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraTimeOptions {
    /// Whether they are learned, where the motion is `free-time`. Where not, frames were exposed when they say.
    pub enabled: bool,
    /// Share of the run after which learning starts: the scene has to be there first.
    pub from: f32,
    /// Learning rate, RGB intervals: first, last.
    pub rate: [f32; 2],
    /// Minimum number of frame cameras for theirs to be learned. With fewer, a wrong scene absorbs clock errors.
    pub fewest: u32,
    /// Whether those of event cameras without frames are learned, beside any number of frame cameras. They include the lag of counts of whole
    /// thresholds.
    #[serde(default)]
    pub events: bool,
    /// Maximum time offset, in standard deviations of the camera's clock, where the dataset states these.
    #[serde(default = "within")]
    pub within: f32,
}

impl Default for CameraTimeOptions {
    fn default() -> Self {
        Self { enabled: false, from: 0.25, rate: [0.02, 0.001], fewest: 8, events: false, within: within() }
    }
}

impl CameraTimeOptions {
    /// Whether frames tell of clocks at a `share` of the whole run.
    pub(crate) fn due(&self, share: f64) -> bool {
        share >= f64::from(self.from)
    }

    pub(crate) fn rule(&self) -> Rule {
        Rule { rate: self.rate, within: self.within }
    }
}

/// A camera whose clock is learned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Learner {
    /// Its number among all cameras.
    pub camera: usize,
    /// How sure its times are as a whole, RGB intervals, where its calibration tells.
    pub sigma: Option<f64>,
    /// Whether it takes frames, which date the scene.
    pub dates: bool,
}

/// How much later a camera recorded than its frames or events say, RGB intervals.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OfClock;

impl Quantity for OfClock {
    const NAME: &'static str = "camera-times";
    const FLOATS: usize = 1;
    const SUMS: usize = ClockRow::FLOATS;
}

impl Summed for OfClock {
    const GRADIENTS: &'static [usize] = &[0];
    const RENDERINGS: usize = 1;
    type Learner = Learner;

    fn camera(learner: &Learner) -> usize {
        learner.camera
    }

    fn units(learner: &Learner, _: usize, rate: f64) -> [f64; 2] {
        // What is known well goes by smaller steps.
        [1.0, learner.sigma.map_or(rate, |sigma| rate.min(STEP * sigma))]
    }

    fn sigma(learner: &Learner, _: usize) -> Option<f64> {
        learner.sigma
    }

    fn take_common(state: &mut CameraTimeState, learners: &[Learner]) {
        let dating: Vec<Learner> = learners.iter().copied().filter(|learner| learner.dates).collect();
        if dating.is_empty() {
            return;
        }
        let common = state.common(&dating) as f32;
        dating.iter().for_each(|learner| state.values[learner.camera] -= common);
    }
}

/// What the clocks of all cameras have learned.
pub type CameraTimeState = CameraState<OfClock>;

impl CameraTimeState {
    /// Of so many cameras, as their frames say.
    #[must_use]
    pub fn labelled(cameras: usize) -> Self {
        Self::zero(cameras)
    }

    /// What all cameras have in common: the mean, in which a camera counts by how sure its clock is; where that is told of some
    /// alone, these decide.
    fn common(&self, learners: &[Learner]) -> f64 {
        let stated = learners.iter().any(|learner| learner.sigma.is_some());
        let weight = |learner: &Learner| match learner.sigma {
            Some(sigma) => sigma.max(CERTAIN).powi(-2),
            None if stated => 0.0,
            None => 1.0,
        };
        let [sum, weights] = learners.iter().fold([0.0; 2], |[sum, weights], learner| {
            let weight = weight(learner);
            [sum + weight * f64::from(self.values[learner.camera]), weights + weight]
        });
        sum / weights
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::{super::take_step, *};

    fn learners(cameras: usize, sigma: Option<f64>) -> Vec<Learner> {
        (0..cameras).map(|camera| Learner { camera, sigma, dates: true }).collect()
    }

    /// What `steps` come to where each camera's gradient is `slope` times how far its clock is from `truth`, and noise of size `noise`.
    fn learned(truth: &[f32], sigma: Option<f64>, slope: f64, noise: f64, steps: u64) -> CameraTimeState {
        found(truth, &learners(truth.len(), sigma), slope, noise, steps)
    }

    fn found(truth: &[f32], learners: &[Learner], slope: f64, noise: f64, steps: u64) -> CameraTimeState {
        let mut state = CameraTimeState::labelled(truth.len());
        let options = CameraTimeOptions::default();
        for step in 0..steps {
            // The scene is where the cameras have it in the mean.
            let apart = |camera: usize| f64::from(state.values[camera] - truth[camera]);
            let common = learners.iter().map(|learner| apart(learner.camera)).sum::<f64>() / learners.len() as f64;
            let row = |&Learner { camera, .. }: &Learner| {
                let chance = random::range(random::key(3, &[step, camera as u64]), -noise, noise);
                [(slope * (apart(camera) - common) + chance) as f32 * 2.0, 2.0]
            };
            let sums: Vec<f32> = learners.iter().flat_map(row).collect();
            take_step(&mut state, learners, &sums, options.rule(), step as f64 / steps as f64);
        }
        state
    }

    #[test]
    fn clocks_are_found_beside_noise() {
        let truth = [0.2_f32, -0.1, 0.0, 0.3];
        let state = learned(&truth, None, 1.0, 0.03, 150);
        for (found, truth) in state.values.iter().zip(truth) {
            assert!((found - (truth - 0.1)).abs() < 0.04, "{found} of {truth}, of which all have 0.1");
        }
    }

    #[test]
    fn a_clock_stays_within_what_is_stated() {
        // Wrong by five times what is stated: it goes as far as it may.
        let truth = [0.05, -0.05];
        let state = learned(&truth, Some(0.01), 1.0, 0.0, 150);
        for (found, truth) in state.values.iter().zip(truth) {
            assert!((found - 0.6 * truth).abs() < 1e-6, "{found} of {truth}");
        }
        // Wrong by one standard deviation, which is found although steps were longer than that.
        let truth = [0.001, -0.001, 0.0];
        let state = learned(&truth, Some(0.001), 1.0, 1e-4, 300);
        for (found, truth) in state.values.iter().zip(truth) {
            assert!((found - truth).abs() < 3e-4, "{found} of {truth}");
        }
        // One that is certain stays where it is.
        assert_eq!(learned(&[0.2, 0.0], Some(0.0), 1.0, 0.0, 20).values, [0.0; 2]);
    }

    #[test]
    fn those_that_are_sure_tell_where_the_others_are() {
        let truth = [0.0, 0.0, 0.3, 0.2];
        for unsure in [None, Some(0.2)] {
            let mut learners = learners(4, Some(1e-4));
            learners[2..].iter_mut().for_each(|learner| learner.sigma = unsure);
            let state = found(&truth, &learners, 1.0, 0.03, 300);
            for (found, truth) in state.values.iter().zip(truth) {
                assert!((found - truth).abs() < 0.04, "{found} of {truth}");
            }
        }
    }

    #[test]
    fn event_cameras_are_late_together_and_frames_stay() {
        let (truth, mut learners) = ([0.1_f32, -0.1, -0.05, -0.04], learners(4, None));
        learners[2..].iter_mut().for_each(|learner| learner.dates = false);
        let mut state = CameraTimeState::labelled(4);
        for step in 0..300 {
            let sums: Vec<f32> = (0..4).flat_map(|camera| [state.values[camera] - truth[camera], 1.0]).collect();
            take_step(&mut state, &learners, &sums, CameraTimeOptions::default().rule(), f64::from(step) / 300.0);
        }
        for (found, truth) in state.values.iter().zip(truth) {
            assert!((found - truth).abs() < 4e-3, "{found} of {truth}");
        }
        // Without frames that are learned, too.
        let mut alone = CameraTimeState::labelled(4);
        take_step(
            &mut alone,
            &learners[2..],
            &[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0],
            CameraTimeOptions::default().rule(),
            0.0,
        );
        assert!(alone.values.iter().all(|late| late.is_finite()), "{:?}", alone.values);
    }

    #[test]
    fn chance_moves_no_clock_far() {
        let state = learned(&[0.0; 8], None, 0.0, 1.0, 150);
        assert!(state.values.iter().all(|late| late.abs() < 0.2), "{:?}", state.values);
    }

    #[test]
    fn a_camera_of_which_nothing_is_said_stays_as_it_was() {
        let mut state = CameraTimeState::labelled(2);
        for row in [[0.0, 0.0], [f32::NAN, 1.0], [f32::INFINITY, 3.0]] {
            take_step(
                &mut state,
                &learners(2, None),
                &[row[0], row[1], 0.0, 0.0],
                CameraTimeOptions::default().rule(),
                0.5,
            );
        }
        assert_eq!(state, CameraTimeState::labelled(2));
    }
}
