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
    let text = "<p>How much later than its frames say training found each camera to have taken them, by what moves in them and in those of the \
                others. What all cameras have in common is not told. Cameras that a pulse triggers come out within a \
                millisecond or so; one that stands out runs on a clock of its own.</p>\n";
    html::section(&scene.prefix, "camera-times", "When the cameras looked", &(text.to_owned() + &table))
}
