//! When the training cameras were found to have taken their frames, beside what these say.

use super::{
    html::{self, number},
    load::{Run, Scene},
    per_camera,
};

/// How much later each camera's frames are, one column a run.
pub(super) fn section(scene: &Scene) -> String {
    let runs: Vec<&Run> = scene.runs.iter().filter(|run| !run.info.camera_times.is_empty()).collect();
    let Some(first) = runs.first() else { return String::new() };
    let cameras = first.info.camera_times.iter().map(|of| &of.camera);
    let table = per_camera::table(&runs, "ms", cameras, |run, camera| {
        let of = run.info.camera_times.iter().find(|of| of.camera == camera)?;
        Some(number(of.late_ms, 1))
    });
    let text = "<p>Time offset of each camera that training learned from what moves: positive if its frames were taken later than \
    their stamps. An offset common to all cameras cannot be learned. Triggered cameras agree to about a millisecond; a camera that \
    stands out runs on its own clock. An event camera's offset is relative to the frames: negative if its events are stamped later than \
    what they saw, as pixels answer late in dim light.</p>\n";
    html::section(&scene.prefix, "camera-times", "When the cameras looked", &(text.to_owned() + &table))
}
