//! Cameras as each is by itself.

use erfgs_scene::{
    Modality,
    rig_file::{RigCamera, RigFile},
};

use super::{
    super::{BoardDetections, alone::Alone},
    Calibrated,
    warnings::{coverage_warnings, focal_warning},
};
use crate::evidence::Evidence;

/// Each camera as it is by itself: no poses.
pub(super) fn by_themselves(seen: &[&BoardDetections], alone: &[&Alone]) -> Calibrated {
    let mut evidence = Evidence::default();
    let mut rig = RigFile::new("board", true, Vec::new());
    for (index, (seen, alone)) in seen.iter().zip(alone).enumerate() {
        let (name, modality) = (&seen.camera, modality(seen));
        if let Some(solution) = &alone.solution {
            evidence.pass(format!("intrinsics of {name}"), solution);
        }
        evidence.observe_also(&alone.bundle, index, &alone.moments);
        let mut camera = match &alone.single {
            Some(single) => {
                let mut own = alone.bundle.rig("board", &single.uncertainty, &[modality]);
                rig.quality = rig.quality.take().or(own.quality.take());
                own.cameras.remove(0)
            }
            None => {
                let mut camera = RigCamera::new(name, modality, alone.intrinsics, None);
                let (rms_px, observations) = alone.bundle.rms_px(None);
                (camera.rms_px, camera.observations) = (Some(rms_px), observations);
                camera
            }
        };
        // One camera stands nowhere but where it is.
        camera.pose = None;
        camera.warnings = coverage_warnings(seen);
        camera.warnings.extend(focal_warning(&camera));
        rig.cameras.push(camera);
    }
    if rig.cameras.len() > 1 {
        // Of several problems there is no one measure.
        rig.quality = None;
    }
    rig.warnings.extend(alone.iter().filter_map(|alone| alone.is_another()).map(|(_, sentence)| sentence));
    (rig, evidence)
}

pub(super) fn modality(seen: &BoardDetections) -> Modality {
    if seen.events { Modality::Event } else { Modality::Rgb }
}
