//! COLMAP models: conventions are ours; an image stands for each camera.

use std::{collections::BTreeSet, path::Path};

use crate::{
    Modality,
    colmap::{ColmapCamera, ColmapImage, Model},
};

use super::{ExchangeError, Format, losses, pose};
use crate::rig_file::{RigCamera, RigFile};

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ExchangeError> {
    let mut model = Model::default();
    for (id, camera) in (1..).zip(&rig.cameras) {
        let name = format!("{}.png", camera.name);
        model
            .images
            .insert(id, ColmapImage { pose: pose(camera, Format::Colmap)?, camera: id, name, points: Vec::new() });
        model.cameras.insert(id, ColmapCamera::from_intrinsics(&camera.intrinsics));
    }
    model.write_text(out)?;
    Ok(losses::common(rig, Format::Colmap))
}

pub(super) fn read(path: &Path) -> Result<RigFile, ExchangeError> {
    let model = Model::read(path)?;
    let camera = |image: &ColmapImage| {
        let name = Path::new(&image.name).with_extension("").to_string_lossy().into_owned();
        let wrong = |what| ExchangeError::Camera { camera: name.clone(), path: path.into(), what };
        // References were checked as the model was read.
        let lens = model.cameras.get(&image.camera).map(ColmapCamera::intrinsics).transpose();
        let lens = lens.map_err(|error| wrong(error.to_string()))?;
        let pose = image.pose.checked().map_err(|error| wrong(error.to_string()))?;
        Ok(lens.map(|intrinsics| RigCamera::new(&name, Modality::Rgb, intrinsics, Some(pose))))
    };
    let cameras: Vec<Option<RigCamera>> = model.images.values().map(camera).collect::<Result<_, ExchangeError>>()?;
    // A model from images alone has no scale, and the files do not say.
    let mut rig = RigFile::new("colmap", false, cameras.into_iter().flatten().collect());
    rig.warnings.push("a COLMAP model does not say whether its unit is the metre".into());
    if !model.points.is_empty() {
        rig.warnings
            .push(format!("the {} points of the COLMAP model are not kept: a rig has none", model.points.len()));
    }
    let used: BTreeSet<u32> = model.images.values().map(|image| image.camera).collect();
    let unused = model.cameras.keys().filter(|id| !used.contains(id)).count();
    if unused > 0 {
        rig.warnings.push(format!("{unused} cameras of the COLMAP model have no image and are left out"));
    }
    Ok(rig)
}
