//! `--path`: where the camera of a rendering goes.

use anyhow::Context;
use erfgs_dataset::{Camera, Manifest, Split};
use erfgs_scene::{
    Pose,
    camera_path::{Station, key_frames, orbit},
};

use crate::errors::Usage;

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
    pub fn stations(&self, recording: &Manifest, frames: usize) -> anyhow::Result<Vec<Station>> {
        match self {
            Self::Orbit => {
                let poses: Vec<Pose> = recording.cameras.iter().map(|camera| camera.world_to_camera).collect();
                Ok(orbit(&poses, &station(model(recording)?), frames)?)
            }
            Self::Camera(name) => {
                let camera = recording.cameras.iter().find(|camera| camera.name == *name).ok_or_else(|| {
                    let names: Vec<&str> = recording.cameras.iter().map(|camera| camera.name.as_str()).collect();
                    Usage(format!("there is no camera '{name}'; the dataset has {}", names.join(", ")))
                })?;
                Ok(vec![station(camera); frames])
            }
            Self::File(file) => Ok(key_frames(file, &model(recording)?.intrinsics, frames)?),
        }
    }
}

fn station(camera: &Camera) -> Station {
    Station { intrinsics: camera.intrinsics, world_to_camera: camera.world_to_camera, time_s: None }
}

/// The camera that gives the size and focal length of a path: the first held-out one, else the first.
fn model(recording: &Manifest) -> anyhow::Result<&Camera> {
    let held_out = recording.cameras.iter().find(|camera| camera.split == Split::Test);
    held_out.or(recording.cameras.first()).context("the dataset has no cameras")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_a_path_are_orbit_camera_or_a_file() {
        let words = |text: &str| Choice::from_words(&text.split(' ').map(String::from).collect::<Vec<_>>());
        assert_eq!(words("orbit").ok(), Some(Choice::Orbit));
        assert_eq!(words("camera 03").ok(), Some(Choice::Camera("03".into())));
        assert_eq!(words("keys.json").ok(), Some(Choice::File("keys.json".into())));
        assert!(words("camera").is_err() && words("orbit 3").is_err());
    }
}
