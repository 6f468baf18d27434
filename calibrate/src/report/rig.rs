//! Where the cameras stand.

use glam::DVec3;

use super::space::{Shown, class, drawing, extent};
use erfgs_scene::rig_file::RigFile;

pub(super) fn picture(rig: &RigFile) -> String {
    let posed = rig.cameras.iter().filter_map(|camera| Some((camera, camera.pose?)));
    let shown: Vec<Shown<'_>> = posed
        .map(|(camera, pose)| Shown {
            name: &camera.name,
            class: class(camera.modality),
            intrinsics: &camera.intrinsics,
            pose,
        })
        .collect();
    let centres: Vec<DVec3> = shown.iter().map(|camera| camera.pose.centre()).collect();
    let far = match extent(&centres) {
        Some((_, reach)) if rig.metric => format!("; the farthest is {reach:.2} m from their middle"),
        _ => String::new(),
    };
    drawing(&shown, &format!("Drag to turn. Blue: RGB; orange: events{far}."))
}
