//! Where the training cameras were found to stand, beside their calibration.

use glam::DVec3;

use super::{
    html::{self, number},
    load::{Run, Scene},
    per_camera,
};

/// How far each camera was moved, one column a run.
pub(super) fn section(scene: &Scene) -> String {
    let runs: Vec<&Run> = scene.runs.iter().filter(|run| !run.info.camera_poses.is_empty()).collect();
    let Some(first) = runs.first() else { return String::new() };
    let cameras = first.info.camera_poses.iter().map(|of| &of.camera);
    let table = per_camera::table(&runs, "px mm degrees", cameras, |run, camera| {
        let of = run.info.camera_poses.iter().find(|of| of.camera == camera)?;
        let (shift, turn) = (1e3 * DVec3::from(of.shift_m).length(), DVec3::from(of.turn_degrees).length());
        Some(format!("{} {} {}", number(of.moved_px, 2), number(shift, 1), number(turn, 3)))
    });
    let text = "<p>Difference of the learned pose of each camera from its calibration: image shift (root mean square, at the depth \
    of the scene), translation and rotation. A difference common to all cameras cannot be learned. Some tenths of a pixel are usual; \
    a camera that stands out was moved, or badly calibrated.</p>\n";
    html::section(&scene.prefix, "camera-poses", "Where the cameras stand", &(text.to_owned() + &table))
}
