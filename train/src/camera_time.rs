//! The clocks of the training cameras, learned beside the scene.
//!
//! A camera without a trigger tells when it exposed its frames to some milliseconds, in which what is fast goes some pixels: what cameras do
//! not agree on is smeared. Each camera that takes frames gets a time of its own that its frames were exposed later than they say, by the
//! gradients of what moves. No frame tells a scene that is later from cameras that are, and events too weakly: what all cameras have in
//! common is taken from them after each step.

use serde::{Deserialize, Serialize};

use crate::{motion::ClockRow, optimiser::cautious_step, schedule::decayed};

/// How the clocks of the cameras are learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraTimeOptions {
    /// Whether they are learned, where the motion is `free-time`. Where not, frames were exposed when they say.
    pub enabled: bool,
    /// From when on, as a share of the whole run: the scene comes first.
    pub from: f32,
    /// Learning rate, RGB intervals: first, last.
    pub rate: [f32; 2],
    /// So many cameras must take frames. What few see, a scene that is wrong explains as well.
    pub fewest: u32,
}

impl Default for CameraTimeOptions {
    fn default() -> Self {
        Self { enabled: false, from: 0.25, rate: [0.02, 0.001], fewest: 8 }
    }
}

impl CameraTimeOptions {
    /// Whether frames tell of clocks at a `share` of the whole run.
    pub(crate) fn due(&self, share: f64) -> bool {
        share >= f64::from(self.from)
    }
}

/// What the clocks of all cameras have learned, with the state of their optimiser.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraTimeState {
    /// Steps that each camera took.
    pub steps: Vec<u32>,
    /// How much later each camera exposed its frames than they say, RGB intervals.
    pub values: Vec<f32>,
    /// First and second moments of the gradients, like `values`.
    pub moments: [Vec<f32>; 2],
    /// Gradients of renderings since the last step: [`ClockRow::FLOATS`] a camera.
    pub sums: Vec<f32>,
}

impl CameraTimeState {
    /// Of so many cameras, as their frames say.
    #[must_use]
    pub fn labelled(cameras: usize) -> Self {
        let zeros = || vec![0.0; cameras];
        let sums = vec![0.0; cameras * ClockRow::FLOATS];
        Self { steps: vec![0; cameras], values: zeros(), moments: [zeros(), zeros()], sums }
    }

    /// A step of the cameras `learners` that `sums` (rows of [`ClockRow::FLOATS`]) tell of, then what all of them have in common is taken
    /// away.
    pub(crate) fn step(&mut self, learners: &[usize], sums: &[f32], rate: [f32; 2], share: f64) {
        let rate = f64::from(decayed(rate, share));
        for &camera in learners {
            let row = &sums[camera * ClockRow::FLOATS..][..ClockRow::FLOATS];
            let gradient = f64::from(row[0]) / f64::from(row[1]);
            if row[1] < 1.0 || !gradient.is_finite() {
                continue;
            }
            self.steps[camera] += 1;
            let [first, second] = &mut self.moments;
            let sure = cautious_step(self.steps[camera], [&mut first[camera], &mut second[camera]], gradient);
            self.values[camera] -= (rate * sure) as f32;
        }
        let mean = learners.iter().map(|camera| f64::from(self.values[*camera])).sum::<f64>() / learners.len() as f64;
        learners.iter().for_each(|camera| self.values[*camera] -= mean as f32);
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    /// What `steps` come to where each camera's gradient is `slope` times how far its clock is from `truth`, and noise of size `noise`.
    fn learned(truth: &[f32], slope: f64, noise: f64, steps: u64) -> CameraTimeState {
        let mut state = CameraTimeState::labelled(truth.len());
        let learners: Vec<usize> = (0..truth.len()).collect();
        for step in 0..steps {
            // The scene is where the cameras have it in the mean.
            let apart = |camera: usize| f64::from(state.values[camera] - truth[camera]);
            let common = learners.iter().map(|camera| apart(*camera)).sum::<f64>() / learners.len() as f64;
            let row = |camera: &usize| {
                let camera = *camera;
                let chance = random::range(random::key(3, &[step, camera as u64]), -noise, noise);
                [(slope * (apart(camera) - common) + chance) as f32 * 2.0, 2.0]
            };
            let sums: Vec<f32> = learners.iter().flat_map(row).collect();
            state.step(&learners, &sums, [0.02, 0.001], step as f64 / steps as f64);
        }
        state
    }

    #[test]
    fn clocks_are_found_beside_noise() {
        let truth = [0.2_f32, -0.1, 0.0, 0.3];
        let state = learned(&truth, 1.0, 0.03, 150);
        for (found, truth) in state.values.iter().zip(truth) {
            assert!((found - (truth - 0.1)).abs() < 0.04, "{found} of {truth}, of which all have 0.1");
        }
    }

    #[test]
    fn chance_moves_no_clock_far() {
        let state = learned(&[0.0; 8], 0.0, 1.0, 150);
        assert!(state.values.iter().all(|late| late.abs() < 0.2), "{:?}", state.values);
    }

    #[test]
    fn a_camera_of_which_nothing_is_said_stays_as_it_was() {
        let mut state = CameraTimeState::labelled(2);
        for said in [[0.0, 0.0], [f32::NAN, 1.0], [f32::INFINITY, 3.0]] {
            state.step(&[0, 1], &[said[0], said[1], 0.0, 0.0], [0.1, 0.1], 0.5);
        }
        assert_eq!(state, CameraTimeState::labelled(2));
    }
}
