//! Whether a rig still stands as it was calibrated.
//!
//! A later calibration has a frame of its own. It is laid over the earlier one by the camera with which most others agree; the
//! cameras that do not agree have moved. With two cameras there is no majority, and only that they moved against each other can
//! be said.

use erfgs_scene::Pose;
use glam::DVec3;
use serde::Serialize;

use erfgs_scene::rig_file::{RigCamera, RigFile};

/// A difference of so many standard deviations is no accident.
const SIGNIFICANT: f64 = 4.0;

/// From what on a movement is reported, however well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Metres.
    pub shift_m: f64,
    /// Degrees.
    pub turn_deg: f64,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self { shift_m: 1e-3, turn_deg: 0.05 }
    }
}

/// How one camera compares.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drift {
    /// Its name.
    pub camera: String,
    /// By how far its centre moved, millimetres.
    pub shift_mm: f64,
    /// Standard deviation of that, from both calibrations.
    pub shift_sigma_mm: f64,
    /// What of it is let pass: the tolerance, or four standard deviations where that is more.
    pub shift_limit_mm: f64,
    /// By how much it turned, degrees.
    pub turn_deg: f64,
    /// Standard deviation of that.
    pub turn_sigma_deg: f64,
    /// What of it is let pass.
    pub turn_limit_deg: f64,
    /// Whether one of them is beyond its limit.
    pub moved: bool,
    /// Its world-to-camera pose in the later calibration, in the world of the earlier one.
    pub now: Pose,
}

/// A comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The cameras that both have, in the order of the earlier rig.
    pub cameras: Vec<Drift>,
    /// The camera by which the later calibration is laid over the earlier one.
    pub anchor: String,
    /// Whether more than half of the cameras agree, so that those that do not are the ones that moved.
    pub majority: bool,
    /// Cameras that only one of the two has with a pose.
    pub missing: Vec<String>,
}

/// Two rigs that cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the two rigs have {common} cameras with poses in common, and two are needed; check that the cameras are named alike"
)]
pub struct NothingInCommon {
    /// Cameras that both have.
    pub common: usize,
}

/// Compares a later calibration with an earlier one.
///
/// # Errors
/// If they have fewer than two cameras in common.
pub fn compare(earlier: &RigFile, later: &RigFile, tolerance: Tolerance) -> Result<Comparison, NothingInCommon> {
    let mut missing = Vec::new();
    let mut pairs: Vec<(&RigCamera, Pose, &RigCamera, Pose)> = Vec::new();
    for camera in &earlier.cameras {
        match (camera.pose, later.camera(&camera.name).and_then(|other| Some((other, other.pose?)))) {
            (Some(pose), Some((other, other_pose))) => pairs.push((camera, pose, other, other_pose)),
            _ => missing.push(camera.name.clone()),
        }
    }
    missing.extend(later.cameras.iter().filter(|c| earlier.camera(&c.name).is_none()).map(|c| c.name.clone()));
    if pairs.len() < 2 {
        return Err(NothingInCommon { common: pairs.len() });
    }
    let by_anchor = |anchor: usize| -> Vec<Drift> {
        let (own, before, own_later, after) = pairs[anchor];
        // From the later world through the anchor camera to the earlier world.
        let to_earlier = |point: DVec3| before.inverse().transform(after.transform(point));
        let turn = before.rotation.conjugate() * after.rotation;
        let placed = |later: &Pose| {
            let rotation = (later.rotation * turn.conjugate()).normalize();
            Pose { rotation, translation: -(rotation * to_earlier(later.centre())) }
        };
        pairs
            .iter()
            .enumerate()
            .map(|(index, &(camera, earlier, other, later))| {
                let now = placed(&later);
                let shift = (now.centre() - earlier.centre()).length();
                let turned = now.rotation.angle_between(earlier.rotation).to_degrees();
                let mut of = [spread(camera), spread(other)].to_vec();
                if index != anchor {
                    of.extend([spread(own), spread(own_later)]);
                }
                let distance = (earlier.centre() - before.centre()).length();
                // An anchor that is turned wrongly swings what is far from it.
                let swing = if index == anchor { 0.0 } else { distance * (of[2][1].hypot(of[3][1])).to_radians() };
                let shift_sigma = of.iter().map(|s| s[0] * s[0]).sum::<f64>().sqrt().hypot(swing);
                let turn_sigma = of.iter().map(|s| s[1] * s[1]).sum::<f64>().sqrt();
                let shift_limit = tolerance.shift_m.max(SIGNIFICANT * shift_sigma);
                let turn_limit = tolerance.turn_deg.max(SIGNIFICANT * turn_sigma);
                Drift {
                    camera: camera.name.clone(),
                    shift_mm: 1e3 * shift,
                    shift_sigma_mm: 1e3 * shift_sigma,
                    shift_limit_mm: 1e3 * shift_limit,
                    turn_deg: turned,
                    turn_sigma_deg: turn_sigma,
                    turn_limit_deg: turn_limit,
                    moved: shift > shift_limit || turned > turn_limit,
                    now,
                }
            })
            .collect()
    };
    let agree = |drifts: &[Drift]| drifts.iter().filter(|drift| !drift.moved).count();
    let total = |drifts: &[Drift]| drifts.iter().map(|drift| drift.shift_mm).sum::<f64>();
    let (anchor, cameras) = (0..pairs.len())
        .map(|anchor| (pairs[anchor].0.name.clone(), by_anchor(anchor)))
        .max_by(|(_, a), (_, b)| agree(a).cmp(&agree(b)).then(total(b).total_cmp(&total(a))))
        .unwrap_or_default();
    let majority = 2 * agree(&cameras) > cameras.len();
    Ok(Comparison { cameras, anchor, majority, missing })
}

impl Comparison {
    /// The cameras that moved.
    pub fn moved(&self) -> impl Iterator<Item = &Drift> {
        self.cameras.iter().filter(|drift| drift.moved)
    }
}

/// Standard deviations of a camera's centre (metres) and of its turn (degrees); 0 where they are not known.
fn spread(camera: &RigCamera) -> [f64; 2] {
    let length = |values: &[Option<f64>; 3]| values.iter().flatten().map(|value| value * value).sum::<f64>().sqrt();
    camera.sigma.as_ref().map_or([0.0; 2], |sigma| [length(&sigma.centre_m), length(&sigma.rotation_deg)])
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics, Modality};
    use glam::DQuat;

    use super::*;
    use erfgs_scene::rig_file::Sigma;

    fn rig(count: usize) -> RigFile {
        let intrinsics =
            Intrinsics { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0, distortion: Distortion::None };
        let cameras = (0..count).map(|i| {
            let angle = i as f64;
            let eye = DVec3::new(2.0 * angle.sin(), -0.3, 2.0 * angle.cos());
            let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Y);
            let mut camera = RigCamera::new(&format!("c{i}"), Modality::Rgb, intrinsics, Some(pose));
            camera.sigma =
                Some(Sigma { centre_m: [Some(1e-4); 3], rotation_deg: [Some(0.003); 3], ..Sigma::default() });
            camera
        });
        RigFile::new("wand", true, cameras.collect())
    }

    /// The same rig in another world.
    fn elsewhere(rig: &RigFile) -> RigFile {
        let world = Pose {
            rotation: DQuat::from_scaled_axis(DVec3::new(0.3, 1.2, -0.4)),
            translation: DVec3::new(3.0, 1.0, -2.0),
        };
        let mut rig = rig.clone();
        for pose in rig.cameras.iter_mut().filter_map(|camera| camera.pose.as_mut()) {
            *pose = Pose {
                rotation: pose.rotation * world.rotation,
                translation: pose.rotation * world.translation + pose.translation,
            };
        }
        rig
    }

    #[test]
    fn a_rig_that_stands_still_is_told_so_in_any_world() {
        let comparison = compare(&rig(5), &elsewhere(&rig(5)), Tolerance::default()).unwrap();
        assert!(comparison.majority && comparison.cameras.iter().all(|drift| !drift.moved && drift.shift_mm < 1e-6));
    }

    #[test]
    fn the_camera_that_was_knocked_is_named_even_if_it_is_the_reference() {
        for knocked in [0, 3] {
            let mut later = rig(5);
            let pose = later.cameras[knocked].pose.as_mut().unwrap();
            pose.rotation = DQuat::from_rotation_x(0.01) * pose.rotation;
            pose.translation.x += 0.006;
            let comparison = compare(&rig(5), &elsewhere(&later), Tolerance::default()).unwrap();
            let moved: Vec<&str> = comparison.cameras.iter().filter(|d| d.moved).map(|d| d.camera.as_str()).collect();
            assert_eq!(moved, [format!("c{knocked}")]);
            assert!((comparison.cameras[knocked].turn_deg - 0.01_f64.to_degrees()).abs() < 1e-6);
        }
    }

    #[test]
    fn two_cameras_have_no_majority_and_one_is_refused() {
        let mut later = rig(2);
        later.cameras[1].pose.as_mut().unwrap().translation.y += 0.02;
        let comparison = compare(&rig(2), &later, Tolerance::default()).unwrap();
        assert!(!comparison.majority);
        assert_eq!(compare(&rig(1), &rig(3), Tolerance::default()), Err(NothingInCommon { common: 1 }));
    }
}
