//! Where the cameras stand.

use glam::DVec3;

use super::space::{Scene, Shown, class, drawing, extent};
use erfgs_scene::rig_file::RigFile;

/// The rig in space, and outlines of the boards that it saw.
pub(super) fn picture(rig: &RigFile, outlines: &[[DVec3; 4]]) -> String {
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
    let boards = if outlines.is_empty() { "" } else { "; grey: boards, as they were held" };
    let caption = format!(
        "Drag to turn. Blue: RGB; orange: events{boards}; the three axes stand in the world's origin: x red, y green, z blue{far}."
    );
    drawing(&Scene { cameras: &shown, outlines, metric: Some(rig.metric) }, &caption)
}
