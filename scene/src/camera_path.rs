//! Camera paths: the camera of each frame that is rendered.

use std::{
    io,
    path::{Path, PathBuf},
};

use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;

use crate::{Intrinsics, Pose};

/// One frame of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Where it stands.
    pub world_to_camera: Pose,
    /// When, seconds from the start of the recording, where the path says so.
    pub time_s: Option<f64>,
}

/// Why there is no path.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// All cameras stand in one place, or there are none.
    #[error("an orbit needs cameras that stand apart; give --path camera NAME or a file")]
    NoOrbit,
    /// The file of key frames cannot be read.
    #[error("cannot read the camera path {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file holds something else.
    #[error("{} is no camera path; see `erfgs render --help` for its form", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// The file holds no poses, or some that are none, or times of other poses.
    #[error(
        "{}: a camera path needs at least one pose, finite numbers, and in `times_s`, if it is there, a time for each pose",
        path.display()
    )]
    NoPoses {
        /// The file.
        path: PathBuf,
    },
}

/// A full turn in `frames` steps about the point that the cameras at `poses` (world to camera) all look at, at their mean
/// height and distance, from `model` on.
///
/// # Errors
/// If the cameras do not stand apart.
pub fn orbit(poses: &[Pose], model: &Station, frames: usize) -> Result<Vec<Station>, PathError> {
    let down = poses.iter().map(|pose| pose.inverse().rotation * DVec3::Y).sum::<DVec3>().normalize_or(DVec3::Y);
    let target = looked_at(poses);
    let arms: Vec<DVec3> = poses.iter().map(|pose| pose.centre() - target).collect();
    let count = arms.len() as f64;
    let height = arms.iter().map(|arm| arm.dot(down)).sum::<f64>() / count;
    let radius = arms.iter().map(|arm| arm.reject_from_normalized(down).length()).sum::<f64>() / count;
    let first = model.world_to_camera.centre() - target;
    let start = first.reject_from_normalized(down).normalize_or(down.any_orthonormal_vector());
    if poses.is_empty() || radius < 1e-9 {
        return Err(PathError::NoOrbit);
    }
    let stations = (0..frames).map(|frame| {
        let turn = DQuat::from_axis_angle(down, std::f64::consts::TAU * frame as f64 / frames as f64);
        let eye = target + turn * (start * radius) + down * height;
        Station { intrinsics: model.intrinsics, world_to_camera: Pose::look_at(eye, target, down), time_s: None }
    });
    Ok(stations.collect())
}

/// The point nearest to all optical axes, in the least squares sense; the mean of the centres where they are parallel.
fn looked_at(poses: &[Pose]) -> DVec3 {
    let (mut matrix, mut vector, mut mean) = (DMat3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for pose in poses {
        let back = pose.inverse();
        let axis = back.rotation * DVec3::Z;
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        matrix += across;
        vector += across * back.translation;
        mean += back.translation / poses.len() as f64;
    }
    if matrix.determinant().abs() < 1e-6 { mean } else { matrix.inverse() * vector }
}

/// What a path file holds.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathFile {
    /// Intrinsics of all frames; those of the model camera without them.
    intrinsics: Option<Intrinsics>,
    /// Poses at equal distances along the path.
    world_to_camera: Vec<Pose>,
    /// The instant of each, seconds from the start of the recording.
    times_s: Option<Vec<f64>>,
}

/// Poses (and times) of the JSON file `file`, interpolated to `frames` frames; `model` is the camera where the file has none.
///
/// # Errors
/// If the file cannot be read, or holds no path.
pub fn key_frames(file: &Path, model: &Intrinsics, frames: usize) -> Result<Vec<Station>, PathError> {
    let path = || file.to_owned();
    let text = erfgs_base::text::read(file).map_err(|source| PathError::Read { path: path(), source })?;
    let read: PathFile = serde_json::from_str(&text).map_err(|source| PathError::Parse { path: path(), source })?;
    let intrinsics = read.intrinsics.unwrap_or(*model);
    let keys = read.world_to_camera;
    let times = read.times_s.unwrap_or_default();
    let times_fit = times.is_empty() || times.len() == keys.len() && times.iter().all(|time| time.is_finite());
    if keys.is_empty() || !keys.iter().all(Pose::is_finite) || !times_fit {
        return Err(PathError::NoPoses { path: path() });
    }
    let last = keys.len() - 1;
    let stations = (0..frames).map(|frame| {
        let along = last as f64 * frame as f64 / (frames.max(2) - 1) as f64;
        let from = (along as usize).min(last.saturating_sub(1));
        let (to, share) = ((from + 1).min(last), along - from as f64);
        let time_s = times.get(from).zip(times.get(to)).map(|(from, to)| from + share * (to - from));
        Station { intrinsics, world_to_camera: between(&keys[from], &keys[to], share), time_s }
    });
    Ok(stations.collect())
}

/// A pose between two: centres along a line, rotations along the shortest arc.
fn between(a: &Pose, b: &Pose, share: f64) -> Pose {
    let (a, b) = (a.inverse(), b.inverse());
    let rotation = a.rotation.slerp(b.rotation, share).normalize();
    Pose { rotation, translation: a.translation.lerp(b.translation, share) }.inverse()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, z: f64) -> Pose {
        Pose::look_at(DVec3::new(x, -0.5, z), DVec3::new(0.1, 0.2, 0.3), DVec3::Y)
    }

    #[test]
    fn the_cameras_look_at_the_point_where_their_axes_meet() {
        let poses = [pose(2.0, 0.0), pose(0.0, 2.0), pose(-1.0, -1.0)];
        assert!((looked_at(&poses) - DVec3::new(0.1, 0.2, 0.3)).length() < 1e-9);
        let parallel = [0.0, 2.0].map(|x| Pose { translation: DVec3::new(x, 0.0, 0.0), ..Pose::IDENTITY });
        assert_eq!(looked_at(&parallel), DVec3::new(-1.0, 0.0, 0.0));
    }

    #[test]
    fn a_pose_between_two_starts_at_one_and_ends_at_the_other() {
        let (a, b) = (pose(2.0, 0.0), pose(0.0, 2.0));
        for (share, want) in [(0.0, a), (1.0, b)] {
            let got = between(&a, &b, share);
            assert!((got.matrix() - want.matrix()).abs_diff_eq(glam::DMat4::ZERO, 1e-12), "{share}");
        }
        let middle = between(&a, &b, 0.5).centre();
        assert!((middle - (a.centre() + b.centre()) * 0.5).length() < 1e-12);
    }

    fn model() -> Station {
        let intrinsics =
            Intrinsics { width: 8, height: 6, fx: 7.0, fy: 7.0, cx: 4.0, cy: 3.0, distortion: crate::Distortion::None };
        Station { intrinsics, world_to_camera: pose(2.0, 0.3), time_s: None }
    }

    #[test]
    fn an_orbit_keeps_its_distance_and_looks_at_one_point() {
        let poses = [pose(2.1, 0.3), pose(0.1, 2.3), pose(-1.9, 0.3), pose(0.1, -1.7)];
        let stations = orbit(&poses, &model(), 8).unwrap();
        let target = DVec3::new(0.1, 0.2, 0.3);
        let far = (poses[0].centre() - target).length();
        for station in &stations {
            let seen = station.world_to_camera.transform(target);
            assert!((seen - DVec3::new(0.0, 0.0, far)).length() < 1e-9, "{seen}");
        }
        assert!(matches!(orbit(&[pose(2.0, 0.3); 3], &model(), 8), Err(PathError::NoOrbit)));
        assert!(matches!(orbit(&[], &model(), 8), Err(PathError::NoOrbit)));
    }

    #[test]
    fn key_frames_are_passed_through_and_a_file_that_is_no_path_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let write = |text: String| std::fs::write(file.path(), text).unwrap();
        let keys = [pose(2.0, 0.0), pose(0.0, 2.0), pose(-1.0, -1.0)];
        write(serde_json::json!({ "world_to_camera": keys }).to_string());
        let stations = key_frames(file.path(), &model().intrinsics, 5).unwrap();
        for (station, key) in stations.iter().step_by(2).zip(&keys) {
            assert!((station.world_to_camera.matrix() - key.matrix()).abs_diff_eq(glam::DMat4::ZERO, 1e-12));
        }
        assert!(stations.iter().all(|station| station.time_s.is_none()));
        write(serde_json::json!({ "world_to_camera": keys, "times_s": [0.5, 0.5, 1.5] }).to_string());
        let times = key_frames(file.path(), &model().intrinsics, 5).unwrap();
        assert_eq!(times.iter().filter_map(|station| station.time_s).collect::<Vec<_>>(), [0.5, 0.5, 0.5, 1.0, 1.5]);
        let fewer = serde_json::json!({ "world_to_camera": keys, "times_s": [0.5] }).to_string();
        for wrong in ["{}", "{\"world_to_camera\": []}", "[1", &fewer] {
            write(wrong.to_owned());
            let error = key_frames(file.path(), &model().intrinsics, 5).unwrap_err().to_string();
            assert!(error.contains(&file.path().display().to_string()), "{error}");
        }
    }
}
