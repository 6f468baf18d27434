//! What is said beside a rig, though it is not refused.

use erfgs_scene::rig_file::RigCamera;

use super::{
    super::{
        BoardDetections,
        joint::{Joint, Tied},
    },
    BoardOptions,
};
use crate::coverage::Coverage;

/// Says so where a camera's frames come now earlier and now later.
pub(super) fn scattered(joint: &Joint) -> Option<String> {
    const LEAST_S: f64 = 5e-3;
    let each = joint.bundle.cameras.iter().zip(&joint.scatter_s).filter(|(_, scatter_s)| **scatter_s >= LEAST_S);
    let each: Vec<String> =
        each.map(|(camera, scatter_s)| format!("{} by {:.0} ms", camera.name, 1e3 * scatter_s)).collect();
    (!each.is_empty()).then(|| {
        format!(
            "frame times scatter besides their offsets (standard deviation), so that pictures of a fast board get less weight: {}",
            each.join(", ")
        )
    })
}

/// Says so where the back was not found but taken as it was stated.
pub(super) fn as_stated(tied: &Tied<'_>, options: &BoardOptions) -> Option<String> {
    let thickness_m = options.back_thickness_m.filter(|_| tied.back.is_some_and(|back| back.stated && back.seen))?;
    Some(format!(
        "where the back of the board is on it does not follow from the views, and is as it was stated: {:.1} mm behind the front, \
         parallel to it, middles and edges one behind the other. Cameras that see the one side are placed against those that see \
         the other no better than the board is glued",
        1e3 * thickness_m
    ))
}

/// A focal length less certain than this share of it is doubtful.
const DOUBTFUL: f64 = 0.01;

/// Says so where the focal length is doubtful.
pub(super) fn focal_warning(camera: &RigCamera) -> Option<String> {
    let sigma = (*camera.sigma.as_ref()?.intrinsics.get("fx")?)?;
    let share = sigma / camera.intrinsics.fx;
    (share > DOUBTFUL).then(|| {
        format!(
            "its focal length is known only to {:.1} %, which limits its pose; show it the board tilted by 30 degrees and more about \
             both axes",
            100.0 * share
        )
    })
}

/// What a camera's views lack.
pub(super) fn coverage_warnings(seen: &BoardDetections) -> Vec<String> {
    const GRID: usize = 4;
    let mut coverage = Coverage::new(seen.size, [GRID; 2]);
    seen.views.iter().flat_map(|view| &view.corners).for_each(|corner| coverage.see(corner.pixel));
    let (covered, parts) = (coverage.covered(), coverage.parts());
    let mut warnings = Vec::new();
    if let Some((count, first)) = &seen.unreadable {
        warnings.push(format!("{count} pictures could not be read and were skipped: {first}"));
    }
    if covered < parts * 3 / 4 {
        warnings.push(format!(
            "the board covers {covered} of {parts} parts of the image; distortion is not known where it never was"
        ));
    }
    if seen.views.len() < 10 {
        warnings.push(format!("only {} views of the board; 10 or more are advisable", seen.views.len()));
    }
    warnings
}
