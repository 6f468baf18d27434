//! Where the files of a dataset lie by default, relative to its folder. A manifest may name other places inside it.

use std::path::PathBuf;

/// The initial point cloud.
pub const POINTS: &str = "points.ply";

/// Frame `index` (from 0) of a camera.
#[must_use]
pub fn image(camera: &str, index: usize) -> PathBuf {
    PathBuf::from(format!("images/{camera}/{index:05}.png"))
}

/// The mask of moving pixels of frame `index` (from 0) of a camera.
#[must_use]
pub fn mask(camera: &str, index: usize) -> PathBuf {
    PathBuf::from(format!("masks/{camera}/{index:05}.png"))
}

/// The events of a camera.
#[must_use]
pub fn events(camera: &str) -> PathBuf {
    PathBuf::from(format!("events/{camera}.npz"))
}
