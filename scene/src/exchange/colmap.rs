//! COLMAP models: conventions are ours; an image stands for each camera.

use std::path::Path;

use crate::{
    Modality,
    colmap::{ColmapCamera, ColmapImage, Model},
};

use super::{ConvertError, Format, common_losses, pose};
use crate::rig_file::{RigCamera, RigFile};

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ConvertError> {
    let mut model = Model::default();
    for (id, camera) in (1..).zip(&rig.cameras) {
        let name = format!("{}.png", camera.name);
        model
            .images
            .insert(id, ColmapImage { pose: pose(camera, Format::Colmap)?, camera: id, name, points: Vec::new() });
        model.cameras.insert(id, ColmapCamera::from_intrinsics(&camera.intrinsics));
    }
    model.write_text(out)?;
    Ok(common_losses(rig, Format::Colmap))
}

pub(super) fn read(path: &Path) -> Result<RigFile, ConvertError> {
    let model = Model::read(path)?;
    let camera = |image: &ColmapImage| {
        let name = Path::new(&image.name).with_extension("").to_string_lossy().into_owned();
        // References were checked as the model was read.
        let lens = model.cameras.get(&image.camera).map(ColmapCamera::intrinsics).transpose()?;
        Ok(lens.map(|intrinsics| RigCamera::new(&name, Modality::Rgb, intrinsics, Some(image.pose))))
    };
    let cameras: Vec<Option<RigCamera>> = model.images.values().map(camera).collect::<Result<_, ConvertError>>()?;
    // A model from images alone has no scale, and the files do not say.
    let mut rig = RigFile::new("colmap", false, cameras.into_iter().flatten().collect());
    rig.warnings.push("a COLMAP model does not say whether its unit is the metre".into());
    Ok(rig)
}
