//! Camera paths: the camera of each frame that is rendered.

use std::path::Path;

use anyhow::{Context, bail};
use erfgs_dataset::{Camera, Dataset, Split};
use erfgs_scene::{Intrinsics, Pose};
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;

use crate::errors::Usage;

/// One frame of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Where it stands.
    pub world_to_camera: Pose,
}

/// What `--path` names.
#[derive(Clone, Debug, PartialEq)]
pub enum Choice {
    /// A circle round what the cameras look at.
    Orbit,
    /// A camera of the dataset, standing still.
    Camera(String),
    /// A file of key frames.
    File(std::path::PathBuf),
}

impl Choice {
    /// From the words after `--path`.
    pub fn from_words(words: &[String]) -> Result<Self, Usage> {
        match words {
            [word] if word == "orbit" => Ok(Self::Orbit),
            [word, name] if word == "camera" => Ok(Self::Camera(name.clone())),
            [word] if word == "camera" => Err(Usage("--path camera needs the camera's name: --path camera 03".into())),
            [file] => Ok(Self::File(file.into())),
            _ => Err(Usage(format!("--path {}: give orbit, camera NAME, or a file", words.join(" ")))),
        }
    }

    /// The cameras of `frames` frames.
    pub fn stations(&self, dataset: &Dataset, frames: usize) -> anyhow::Result<Vec<Station>> {
        match self {
            Self::Orbit => orbit(dataset, frames),
            Self::Camera(name) => {
                let camera = dataset.camera(name).ok_or_else(|| {
                    let names: Vec<&str> = dataset.manifest.cameras.iter().map(|camera| camera.name.as_str()).collect();
                    Usage(format!("there is no camera '{name}'; the dataset has {}", names.join(", ")))
                })?;
                Ok(vec![station(camera); frames])
            }
            Self::File(file) => key_frames(file, dataset, frames),
        }
    }
}

fn station(camera: &Camera) -> Station {
    Station { intrinsics: camera.intrinsics, world_to_camera: camera.world_to_camera }
}

/// The camera that gives the size and focal length of a path: the first held-out one, else the first.
fn model(dataset: &Dataset) -> anyhow::Result<&Camera> {
    dataset.cameras(Split::Test).next().or(dataset.manifest.cameras.first()).context("the dataset has no cameras")
}

/// A full turn about the point that all cameras look at, at their mean height and distance, from the model camera on.
fn orbit(dataset: &Dataset, frames: usize) -> anyhow::Result<Vec<Station>> {
    let cameras = &dataset.manifest.cameras;
    let model = model(dataset)?;
    let poses: Vec<Pose> = cameras.iter().map(|camera| camera.world_to_camera).collect();
    let down = poses.iter().map(|pose| pose.inverse().rotation * DVec3::Y).sum::<DVec3>().normalize_or(DVec3::Y);
    let target = looked_at(&poses);
    let arms: Vec<DVec3> = poses.iter().map(|pose| pose.centre() - target).collect();
    let count = arms.len() as f64;
    let height = arms.iter().map(|arm| arm.dot(down)).sum::<f64>() / count;
    let radius = arms.iter().map(|arm| arm.reject_from_normalized(down).length()).sum::<f64>() / count;
    let first = model.world_to_camera.centre() - target;
    let start = first.reject_from_normalized(down).normalize_or(down.any_orthonormal_vector());
    if radius < 1e-9 {
        bail!("an orbit needs cameras that stand apart; give --path camera NAME or a file");
    }
    let stations = (0..frames).map(|frame| {
        let turn = DQuat::from_axis_angle(down, std::f64::consts::TAU * frame as f64 / frames as f64);
        let eye = target + turn * (start * radius) + down * height;
        Station { intrinsics: model.intrinsics, world_to_camera: Pose::look_at(eye, target, down) }
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
    /// Intrinsics of all frames; those of the first held-out camera without them.
    intrinsics: Option<Intrinsics>,
    /// Poses at equal distances along the path.
    world_to_camera: Vec<Pose>,
}

/// Poses of a file, interpolated to the number of frames.
fn key_frames(file: &Path, dataset: &Dataset, frames: usize) -> anyhow::Result<Vec<Station>> {
    let text =
        std::fs::read_to_string(file).with_context(|| format!("cannot read the camera path {}", file.display()))?;
    let path: PathFile = serde_json::from_str(&text)
        .with_context(|| format!("{} is no camera path; see `erfgs render --help` for its form", file.display()))?;
    let intrinsics = path.intrinsics.unwrap_or(model(dataset)?.intrinsics);
    let keys = path.world_to_camera;
    if keys.is_empty() || !keys.iter().all(Pose::is_finite) {
        bail!("{}: a camera path needs at least one pose, and finite numbers", file.display());
    }
    let last = keys.len() - 1;
    let stations = (0..frames).map(|frame| {
        let along = last as f64 * frame as f64 / (frames.max(2) - 1) as f64;
        let from = (along as usize).min(last.saturating_sub(1));
        let pose = between(&keys[from], &keys[(from + 1).min(last)], along - from as f64);
        Station { intrinsics, world_to_camera: pose }
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

    #[test]
    fn the_words_of_a_path_are_orbit_camera_or_a_file() {
        let words = |text: &str| Choice::from_words(&text.split(' ').map(String::from).collect::<Vec<_>>());
        assert_eq!(words("orbit").ok(), Some(Choice::Orbit));
        assert_eq!(words("camera 03").ok(), Some(Choice::Camera("03".into())));
        assert_eq!(words("keys.json").ok(), Some(Choice::File("keys.json".into())));
        assert!(words("camera").is_err() && words("orbit 3").is_err());
    }
}
