//! How the training cameras show colours, as the runs found it.

use super::{
    html::{self, number},
    load::{Run, Scene},
    per_camera,
};

/// The grey of the scene that the table shows as each camera does.
const GREY: f32 = 0.5;

/// What each camera makes of a mid-grey, one column a run.
pub(super) fn section(scene: &Scene) -> String {
    let runs: Vec<&Run> = scene.runs.iter().filter(|run| !run.info.camera_colours.is_empty()).collect();
    let Some(first) = runs.first() else { return String::new() };
    let mut farthest = 0.0_f64;
    let cameras = first.info.camera_colours.iter().map(|of| &of.camera);
    let table = per_camera::table(&runs, "R G B", cameras, |run, camera| {
        let of = run.info.camera_colours.iter().find(|of| of.camera == camera)?;
        let [r, g, b] = std::array::from_fn(|c| f64::from(255.0 * (of.gain[c] * GREY + of.offset[c])));
        let off = [r, g, b].map(|value| (value - 255.0 * f64::from(GREY)).abs());
        farthest = off.into_iter().filter(|off| off.is_finite()).fold(farthest, f64::max);
        let swatch = [r, g, b].map(|value| value.clamp(0.0, 255.0) as u8);
        Some(format!(
            "<span style=\"display:inline-block;width:2.5em;height:1em;background:rgb({},{},{})\"></span> {} {} {}",
            swatch[0],
            swatch[1],
            swatch[2],
            number(r, 1),
            number(g, 1),
            number(b, 1)
        ))
    });
    let text = format!(
        "<p>A mid-grey of the scene ({} of 255) as each training camera shows it, according to its learned gain and offset. The \
         cameras differ from it by up to {} of 255. Held-out cameras have no such correction.</p>\n",
        number(255.0 * f64::from(GREY), 1),
        number(farthest, 1)
    );
    html::section(&scene.prefix, "camera-colours", "Colours of the cameras", &(text + &table))
}
