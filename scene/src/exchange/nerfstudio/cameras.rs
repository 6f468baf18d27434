//! Which frames of a `transforms.json` are of one camera: it lists frames, and a camera that stands still has the same pose in all of its own.

use std::path::{Path, PathBuf};

use crate::{Distortion, Intrinsics, Pose};

/// What frames of one camera have in common, to the bit.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CameraKey(Vec<u64>);

impl CameraKey {
    /// That of a frame.
    #[must_use]
    pub fn new(i: &Intrinsics, pose: &Pose) -> Self {
        let numbers =
            [i.fx, i.fy, i.cx, i.cy].into_iter().chain(pose.rotation.to_array()).chain(pose.translation.to_array());
        let lens = match &i.distortion {
            Distortion::None => &[][..],
            Distortion::BrownConrady(k) => k,
            Distortion::KannalaBrandt(k) => k,
        };
        Self(numbers.chain(lens.iter().copied()).map(f64::to_bits).collect())
    }
}

/// The path that a camera is named by: the folder of its images, or its only image without the extension.
#[must_use]
pub fn camera_path(first: &Path, frames: usize) -> PathBuf {
    if frames > 1 { first.parent().unwrap_or(Path::new("")).to_owned() } else { first.with_extension("") }
}

/// How many frames have both a pose and a time of their own, as those of a camera that moves; none where that is no more than one, or all
/// are of one time. `cameras` has the times of each camera's frames.
#[must_use]
pub fn moving_frames<'a>(cameras: impl IntoIterator<Item = &'a [Option<f64>]>) -> Option<usize> {
    let alone: Vec<f64> =
        cameras.into_iter().filter_map(|times| if let [time] = times { *time } else { None }).collect();
    let several = alone.iter().any(|time| *time != alone[0]);
    several.then_some(alone.len())
}
