//! The poses of the training cameras, learned beside the scene.
//!
//! A calibration is good to some tenths of a pixel, and what its cameras do not agree on is smeared. Each camera that takes frames gets a
//! turn and a shift of its own, by gradients of the frames that are looked at as wholes. Nothing tells a scene that is elsewhere from
//! cameras that are elsewhere: what all cameras have in common - a turn, a shift, a scale - is taken from them after each step.

mod common;

use erfgs_dataset::PoseSigma;
use erfgs_scene::Pose;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use self::common::Common;
use super::{CameraState, Quantity, Rule, Summed};
use erfgs_splat::raster::PoseRow;

/// Numbers that a camera has.
const FLOATS: usize = 6;

/// How the poses of the cameras are learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPoseOptions {
    /// Whether poses are learned. If not, the calibration is used as it is.
    pub enabled: bool,
    /// Share of the run after which learning starts: the scene has to be there first.
    pub from: f32,
    /// Learning rate, pixels in the middle of the scene: first, last.
    pub rate: [f32; 2],
    /// Minimum number of frame cameras. With fewer, a wrong scene absorbs pose errors, and poses drift.
    pub fewest: u32,
    /// Maximum distance from the calibrated pose, in standard deviations of the calibration, where the dataset states these.
    #[serde(default = "within")]
    pub within: f32,
}

/// Of poses and of clocks, also in configurations from before there was a bound: no dataset told deviations then.
pub(crate) fn within() -> f32 {
    3.0
}

impl Default for CameraPoseOptions {
    fn default() -> Self {
        Self { enabled: false, from: 0.25, rate: [0.2, 0.01], fewest: 8, within: within() }
    }
}

impl CameraPoseOptions {
    /// Whether poses are learned at a `share` of the whole run.
    pub(crate) fn due(&self, share: f64) -> bool {
        share >= f64::from(self.from)
    }

    pub(crate) fn rule(&self) -> Rule {
        Rule { rate: self.rate, within: self.within }
    }
}

/// A turn (radians, about a camera's axes) and a shift (metres, along them): a camera at (R, t) that turns by w and shifts by s is at
/// (exp(w) R, exp(w) t + s).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OfPose;

impl Quantity for OfPose {
    const NAME: &'static str = "camera-poses";
    const FLOATS: usize = FLOATS;
    const SUMS: usize = PoseRow::FLOATS;
}

/// What the poses of all cameras have learned.
pub type CameraPoseState = CameraState<OfPose>;

impl CameraPoseState {
    /// Of so many cameras, as they were calibrated.
    #[must_use]
    pub fn calibrated(cameras: usize) -> Self {
        Self::zero(cameras)
    }

    /// The turn and the shift of a camera.
    #[must_use]
    pub fn of(&self, camera: usize) -> [DVec3; 2] {
        let row = self.row(camera);
        [0, 3].map(|at| DVec3::new(row[at].into(), row[at + 1].into(), row[at + 2].into()))
    }

    fn set(&mut self, camera: usize, moved: [DVec3; 2]) {
        let row = self.row_mut(camera);
        for (value, new) in row.iter_mut().zip(moved.iter().flat_map(DVec3::to_array)) {
            *value = new as f32;
        }
    }

    /// The pose of a camera that was calibrated at `pose`.
    #[must_use]
    pub fn moved(&self, camera: usize, pose: &Pose) -> Pose {
        let [turn, shift] = self.of(camera);
        let turn = DQuat::from_scaled_axis(turn);
        Pose { rotation: (turn * pose.rotation).normalize(), translation: turn * pose.translation + shift }
    }
}

/// A camera whose pose is learned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Learner {
    /// Its number among all cameras.
    pub camera: usize,
    /// Where it was calibrated to be.
    pub pose: Pose,
    /// Its focal length, pixels.
    pub focal: f64,
    /// How far the scene is from it, metres.
    pub depth: f64,
    /// How far to either side it sees for half of its picture, of a depth of 1.
    pub reach: f64,
    /// Standard deviations of turns (radians, about its axes) and shifts (metres, along them), where its calibration tells.
    pub sigma: Option<[f64; FLOATS]>,
}

/// [`Learner::sigma`] of a camera at `pose`; a shift along its axes is one of its centre, turned.
pub(crate) fn learner_sigma(sigma: &PoseSigma, pose: &Pose) -> [f64; FLOATS] {
    let [turns, centre] = [sigma.rotation_deg.map(f64::to_radians), sigma.centre_m].map(DVec3::from);
    let rows = DMat3::from_quat(pose.rotation).transpose();
    let along = |axis: DVec3| (axis * centre).length();
    [turns.x, turns.y, turns.z, along(rows.x_axis), along(rows.y_axis), along(rows.z_axis)]
}

impl Summed for OfPose {
    const GRADIENTS: &'static [usize] = &[0, 1, 2, 4, 5, 6];
    const RENDERINGS: usize = 3;
    type Learner = Learner;

    fn camera(learner: &Learner) -> usize {
        learner.camera
    }

    fn units(learner: &Learner, axis: usize, rate: f64) -> [f64; 2] {
        // A pixel is so many radians, or metres.
        let pixel = if axis < 3 { 1.0 / learner.focal } else { learner.depth / learner.focal };
        // What is known better than that goes by smaller steps.
        [pixel, rate * learner.sigma.map_or(pixel, |sigma| pixel.min(sigma[axis]))]
    }

    fn sigma(learner: &Learner, axis: usize) -> Option<f64> {
        learner.sigma.map(|sigma| sigma[axis])
    }

    fn take_common(state: &mut CameraPoseState, learners: &[Learner]) {
        state.take_common(learners);
    }
}

impl CameraPoseState {
    /// How far a camera's picture has moved, pixels: root mean square over its middle and the middles of its quarters, at the scene's
    /// depth.
    pub(crate) fn pixels(&self, learner: &Learner) -> f64 {
        let moved = self.moved(learner.camera, &Pose::IDENTITY);
        let squares = [[0.0, 0.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]].map(|[x, y]| {
            let before = DVec3::new(learner.reach * x, learner.reach * y, 1.0) * learner.depth;
            let after = moved.transform(before);
            (after.truncate() / after.z - before.truncate() / before.z).length_squared()
        });
        learner.focal * (squares.iter().sum::<f64>() / 5.0).sqrt()
    }

    /// Takes from all cameras the turn, the shift and the scale that they have in common.
    fn take_common(&mut self, learners: &[Learner]) {
        // How the camera moved in the world.
        let moved = |learner: &Learner| self.of(learner.camera).map(|by| -(learner.pose.rotation.inverse() * by));
        let common = Common::of(learners, moved);
        for learner in learners {
            let (own, taken) = (self.of(learner.camera), common.at(learner.pose.centre()));
            let rotation = learner.pose.rotation;
            self.set(learner.camera, [0, 1].map(|part| own[part] + rotation * taken[part]));
        }
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::{super::take_step, *};

    /// Cameras on an arc, three metres from the origin, which they look at.
    fn learners(count: usize) -> Vec<Learner> {
        (0..count)
            .map(|camera| {
                let turn =
                    DQuat::from_rotation_y(0.4 * camera as f64) * DQuat::from_rotation_x(0.1 * (camera % 3) as f64);
                let pose = Pose { rotation: turn, translation: DVec3::new(0.0, 0.0, 3.0) };
                Learner { camera, pose, focal: 300.0, depth: 3.0, reach: 0.25, sigma: None }
            })
            .collect()
    }

    fn draw(camera: usize, word: u64, size: f64) -> DVec3 {
        let one = |axis: u64| random::range(random::key(4, &[camera as u64, word, axis]), -size, size);
        DVec3::new(one(0), one(1), one(2))
    }

    #[test]
    fn a_pose_moves_by_its_turn_and_shift() {
        let mut state = CameraPoseState::calibrated(3);
        let pose = learners(3)[2].pose;
        assert_eq!(state.moved(2, &pose).translation, pose.translation);
        state.set(2, [DVec3::new(0.0, 0.01, 0.0), DVec3::ZERO]);
        assert!((state.pixels(&learners(3)[2]) - 3.0).abs() < 0.3, "300 px by a hundredth");
        state.set(2, [DVec3::new(0.0, 0.1, 0.0), DVec3::new(0.0, 0.5, 0.0)]);
        let moved = state.moved(2, &pose);
        let point = DVec3::new(0.3, -0.2, 0.4);
        let expected = DQuat::from_rotation_y(0.1_f32.into()) * pose.transform(point) + DVec3::new(0.0, 0.5, 0.0);
        assert!((moved.transform(point) - expected).length() < 1e-7);
        assert_eq!(state.moved(1, &pose).rotation, pose.rotation);
    }

    #[test]
    fn uncertainty_along_the_world_is_uncertainty_along_a_camera_s_axes() {
        let sigma = PoseSigma { centre_m: [1e-3, 2e-3, 5e-3], rotation_deg: [0.1, 0.2, 0.3] };
        let pose = learners(3)[1].pose;
        let deviations = learner_sigma(&sigma, &pose);
        assert_eq!(deviations[..3], [0.1_f64, 0.2, 0.3].map(f64::to_radians));
        // Of centres that are drawn with these deviations, uniformly within root three of them.
        let draws = 4000;
        let mut squares = DVec3::ZERO;
        for at in 0..draws {
            let centre = pose.centre() + draw(at, 7, 3.0_f64.sqrt()) * DVec3::from(sigma.centre_m);
            let moved = Pose { translation: -(pose.rotation * centre), ..pose };
            let shift = moved.translation - pose.translation;
            squares += shift * shift / draws as f64;
        }
        for (axis, square) in squares.to_array().into_iter().enumerate() {
            let drawn = square.sqrt();
            assert!(
                (deviations[3 + axis] / drawn - 1.0).abs() < 0.05,
                "axis {axis}: {} and {drawn}",
                deviations[3 + axis]
            );
        }
    }

    #[test]
    fn cameras_stay_within_what_their_calibration_tells() {
        let mut learners = learners(4);
        // What is held fast, what is known well, and what is known to less than a pixel.
        for (learner, pixels) in learners.iter_mut().zip([0.0, 0.05, 0.5]) {
            let sigma = |pixel: f64| pixels * pixel;
            let [turn, shift] = [sigma(1.0 / 300.0), sigma(3.0 / 300.0)];
            learner.sigma = Some([turn, turn, turn, shift, shift, shift]);
        }
        let options = CameraPoseOptions::default();
        let mut state = CameraPoseState::calibrated(4);
        for step in 0..200 {
            // All are pulled to one side for ever, each along another axis the most.
            let row = |camera: usize| {
                let mut row = [1.0_f32, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
                row[[0, 1, 5, 6][camera]] *= 20.0;
                row
            };
            let sums: Vec<f32> = (0..4).flat_map(row).collect();
            take_step(&mut state, &learners, &sums, options.rule(), step as f64 / 200.0);
        }
        assert_eq!(state.of(0), [DVec3::ZERO; 2]);
        for (camera, learner) in learners.iter().enumerate().take(3) {
            let sigma = learner.sigma.expect("stated");
            let values = state.of(camera).map(|part| part.to_array()).concat();
            assert!(
                values.iter().zip(sigma).all(|(value, sigma)| value.abs() <= 3.0001 * sigma),
                "{camera}: {values:?}"
            );
        }
        let furthest = |camera: usize| state.pixels(&learners[camera]);
        assert!(
            furthest(1) > 0.05 && furthest(1) < furthest(2) && furthest(2) < furthest(3),
            "{:?}",
            [1, 2, 3].map(furthest)
        );
    }

    #[test]
    fn what_a_scene_elsewhere_would_explain_is_no_camera_s() {
        let (learners, mut state) = (learners(7), CameraPoseState::calibrated(7));
        // All see a scene that is turned, shifted and larger.
        let (turn, shift, scale) = (DVec3::new(2e-3, -1e-3, 3e-3), DVec3::new(4e-3, 1e-3, -2e-3), 1e-3);
        let middle = learners.iter().map(|learner| learner.pose.centre()).sum::<DVec3>() / 7.0;
        for learner in &learners {
            let from = learner.pose.centre() - middle;
            let moved = [turn, shift + turn.cross(from) + scale * from];
            state.set(learner.camera, moved.map(|by| -(learner.pose.rotation * by)));
        }
        state.take_common(&learners);
        assert!(state.values.iter().all(|value| value.abs() < 1e-6), "{:?}", state.values);
        // And what is left after it has nothing more in common.
        (0..7).for_each(|camera| state.set(camera, [draw(camera, 0, 1e-3), draw(camera, 1, 3e-3)]));
        state.take_common(&learners);
        let once = state.clone();
        state.take_common(&learners);
        let apart = state.values.iter().zip(&once.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-5 && once.values.iter().any(|value| value.abs() > 5e-4), "{apart}");
    }

    #[test]
    fn turns_of_all_cameras_about_their_own_axes_are_a_shift_of_the_scene() {
        let (learners, mut state) = (learners(7), CameraPoseState::calibrated(7));
        // All look up by a pixel: their pictures go down together, whatever the world's axes are to them.
        for learner in &learners {
            state.set(learner.camera, [DVec3::new(1.0 / 300.0, 0.0, 0.0), DVec3::ZERO]);
        }
        let pixels = |state: &CameraPoseState| learners.iter().map(|learner| state.pixels(learner)).sum::<f64>() / 7.0;
        let before = pixels(&state);
        state.take_common(&learners);
        assert!(before > 0.99 && pixels(&state) < 0.2, "{before} and {} pixels", pixels(&state));
    }

    #[test]
    fn cameras_find_back_to_where_points_are_seen() {
        let learners = learners(6);
        let points: Vec<DVec3> = (0..40).map(|point| draw(point, 9, 0.8)).collect();
        let mut state = CameraPoseState::calibrated(6);
        // Where they really are, the scene in common taken away.
        let mut truth = CameraPoseState::calibrated(6);
        (0..6).for_each(|camera| truth.set(camera, [draw(camera, 0, 3e-3), draw(camera, 1, 6e-3)]));
        truth.take_common(&learners);
        let off = |state: &CameraPoseState| {
            let pixels = learners.iter().flat_map(|learner| {
                let [a, b] = [state, &truth].map(|state| state.moved(learner.camera, &learner.pose));
                points.iter().map(move |&point| {
                    let [a, b] = [a, b].map(|pose| pose.transform(point)).map(|seen| seen.truncate() / seen.z);
                    learner.focal * (a - b).length()
                })
            });
            pixels.sum::<f64>() / 240.0
        };
        let options = CameraPoseOptions { rate: [0.1, 0.01], ..CameraPoseOptions::default() };
        let before = off(&state);
        for step in 0..300 {
            let mut sums = vec![0.0_f32; 6 * PoseRow::FLOATS];
            for learner in learners.iter().filter(|learner| learner.camera % 2 == step % 2) {
                let [now, there] = [&state, &truth].map(|state| state.moved(learner.camera, &learner.pose));
                let (mut turn, mut shift) = (DVec3::ZERO, DVec3::ZERO);
                for &point in &points {
                    // Of the squared distance in the picture.
                    let (seen, aim) = (now.transform(point), there.transform(point));
                    let away = learner.focal.powi(2) * (seen.truncate() / seen.z - aim.truncate() / aim.z);
                    let d = DVec3::new(away.x, away.y, -away.dot(seen.truncate()) / seen.z) / seen.z;
                    turn += seen.cross(d);
                    shift += d;
                }
                let row = [turn.x, turn.y, turn.z, 2.0, shift.x, shift.y, shift.z, 2.0].map(|value| value as f32);
                sums[learner.camera * PoseRow::FLOATS..][..PoseRow::FLOATS].copy_from_slice(&row);
            }
            take_step(&mut state, &learners, &sums, options.rule(), step as f64 / 300.0);
        }
        let after = off(&state);
        assert!(before > 0.3 && after < 0.1 * before, "{before} px before, {after} px after");
        assert_eq!(state.steps, [150; 6]);
        let still = state.clone();
        take_step(&mut state, &learners, &[f32::NAN; 48], options.rule(), 0.5);
        assert_eq!(state.steps, still.steps, "what is no number is left out");
    }
}
