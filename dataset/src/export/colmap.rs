//! A COLMAP model: a camera for each camera of the rig, an image for each frame, the rig and its instants, and points without tracks.

use std::{collections::BTreeMap, path::Path};

use erfgs_scene::{
    PointCloud,
    colmap::{ColmapCamera, ColmapImage, Model, Point3d},
};
use glam::DVec3;

use super::Image;
use crate::DatasetError;

pub(super) fn write(images: &[Image<'_>], points: Option<&PointCloud>, root: &Path) -> Result<(), DatasetError> {
    let mut model = Model::default();
    let mut ids: BTreeMap<&str, u32> = BTreeMap::new();
    let mut instants: BTreeMap<i64, Vec<u32>> = BTreeMap::new();
    for (image, id) in images.iter().zip(1..) {
        let next = ids.len() as u32 + 1;
        let camera = *ids.entry(&image.camera.name).or_insert(next);
        model.cameras.entry(camera).or_insert_with(|| ColmapCamera::from_intrinsics(&image.camera.intrinsics));
        let (pose, name) = (image.camera.world_to_camera, image.name().to_owned());
        model.images.insert(id, ColmapImage { pose, camera, name, points: Vec::new() });
        instants.entry(image.frame.t_ns).or_default().push(id);
    }
    if let Some(cloud) = points {
        let point = |(position, colour): (&[f32; 3], &[u8; 3])| Point3d {
            position: DVec3::from_array(position.map(f64::from)),
            colour: *colour,
            error: 0.0,
            track: Vec::new(),
        };
        model.points = (1..).zip(cloud.positions.iter().zip(&cloud.colours).map(point)).collect();
    }
    let folder = root.join("sparse/0");
    model.write_binary(&folder)?;
    Ok(model.write_rig(&folder, &instants.into_values().collect::<Vec<_>>())?)
}
