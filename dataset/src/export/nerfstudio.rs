//! nerfstudio's `transforms.json` with times and the split, and the initial points beside it.

use std::path::Path;

use erfgs_scene::{
    PointCloud,
    exchange::nerfstudio::{Shot, write_shots},
};

use super::Image;
use crate::DatasetError;

const POINTS: &str = "points.ply";

pub(super) fn write(
    images: &[Image<'_>],
    points: Option<&PointCloud>,
    [start, end]: [i64; 2],
    root: &Path,
) -> Result<(), DatasetError> {
    let length = end.saturating_sub(start).max(1) as f64;
    let shot = |image: &Image<'_>| Shot {
        file: image.file.clone(),
        camera: image.camera.name.clone(),
        intrinsics: image.camera.intrinsics,
        pose: image.camera.world_to_camera,
        time: image.frame.t_ns.saturating_sub(start) as f64 / length,
        held_out: image.held_out(),
    };
    if let Some(cloud) = points {
        cloud.write(&root.join(POINTS)).map_err(|source| DatasetError::Points { source: Box::new(source) })?;
    }
    let shots: Vec<Shot> = images.iter().map(shot).collect();
    Ok(write_shots(&shots, points.map(|_| POINTS), &root.join("transforms.json"))?)
}
