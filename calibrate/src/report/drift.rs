//! The page of a comparison: which cameras moved since the calibration.

use std::{fmt::Write as _, path::Path};

use erfgs_base::{FileError, atomic};
use erfgs_page::{
    html::{self, Escaped, number},
    plot::{Interval, Intervals},
};
use erfgs_scene::Pose;
use glam::{DQuat, DVec3};

use super::{
    round_down,
    space::{Scene, Shown, drawing, extent},
    styled,
};
use crate::check::{Comparison, Drift};
use erfgs_scene::rig_file::{RigCamera, RigFile};

/// The farthest movement is drawn as long as this share of the rig's size at most.
const LONGEST: f64 = 0.35;
/// The greatest turn is drawn as this at most, degrees.
const WIDEST_DEG: f64 = 15.0;

/// Writes the page of a comparison with `earlier` to `path`.
///
/// # Errors
/// If the file cannot be written.
pub fn write_drift(earlier: &RigFile, comparison: &Comparison, path: &Path) -> Result<(), FileError> {
    atomic::write(path, drift_page(earlier, comparison).as_bytes()).map_err(FileError::when("write the report", path))
}

/// The page of a comparison with `earlier`.
#[must_use]
pub fn drift_page(earlier: &RigFile, comparison: &Comparison) -> String {
    let body = [
        html::section("", "cameras", "Each camera", &(table(comparison) + &charts(comparison))),
        html::section("", "rig", "Before and after", &before_and_after(earlier, comparison)),
    ];
    let title = match comparison.moved().count() {
        0 => "The rig is unchanged",
        _ if !comparison.majority => "Cameras moved relative to each other",
        1 => "A camera moved",
        _ => "Cameras moved",
    };
    html::page(title, &head(earlier, comparison), &styled(&body.concat()))
}

fn names<'a>(drifts: impl Iterator<Item = &'a Drift>) -> String {
    drifts.map(|drift| format!("<b>{}</b>", Escaped(&drift.camera))).collect::<Vec<_>>().join(", ")
}

fn head(earlier: &RigFile, comparison: &Comparison) -> String {
    let count = comparison.cameras.len();
    let moved = comparison.moved().count();
    let mut text = if moved == 0 {
        format!("<p>None of {count} cameras moved by more than the limits below.</p>\n")
    } else if comparison.majority {
        format!(
            "<p>{} moved; the other {} cameras still stand to each other as they did. Calibrate the rig again, or put \
             back what moved.</p>\n",
            names(comparison.moved()),
            count - moved
        )
    } else {
        "<p>Too few cameras agree to say which of them moved. Calibrate the rig again.</p>\n".into()
    };
    let _ = writeln!(
        text,
        "<p>The later calibration is laid over the earlier one by camera <b>{}</b>, with which most others agree; that one \
         shows no movement of its own.</p>",
        Escaped(&comparison.anchor)
    );
    let mut notes = Vec::new();
    if !comparison.missing.is_empty() {
        let names: Vec<String> = comparison.missing.iter().map(|name| Escaped(name).to_string()).collect();
        notes.push(format!("Not compared, since only one of the two rigs has a pose of them: {}", names.join(", ")));
    }
    if !earlier.metric {
        notes.push(
            "The rig has no scale: what is called a millimetre here is a thousandth of its unit of length".into(),
        );
    }
    if !notes.is_empty() {
        let _ = writeln!(text, "<div class=\"notes\"><ul><li>{}</li></ul></div>", notes.join("</li><li>"));
    }
    text
}

fn table(comparison: &Comparison) -> String {
    let row = |drift: &Drift| {
        format!(
            "<tr><td>{}</td><td>{} ± {}</td><td>{}</td><td>{} ± {}</td><td>{}</td><td>{}</td></tr>\n",
            Escaped(&drift.camera),
            number(drift.shift_mm, 2),
            number(drift.shift_sigma_mm, 2),
            number(drift.shift_limit_mm, 2),
            number(drift.turn_deg, 3),
            number(drift.turn_sigma_deg, 3),
            number(drift.turn_limit_deg, 3),
            if drift.moved { "<b>moved</b>" } else { "" }
        )
    };
    let head = "<tr><th>Camera</th><th>Shift <small>mm</small></th><th>Limit <small>mm</small></th>\
                <th>Turn <small>deg</small></th><th>Limit <small>deg</small></th><th></th></tr>";
    html::table("figures", head, &comparison.cameras.iter().map(row).collect::<String>())
        + "<p class=\"caption\">±: the standard deviation from both calibrations; 0 where they state none. The limit is the given \
        one, or four standard deviations if that is more.</p>\n"
}

/// Shifts and turns of all cameras, with their standard deviations and limits.
fn charts(comparison: &Comparison) -> String {
    let shift = |drift: &Drift| [drift.shift_mm, drift.shift_sigma_mm, drift.shift_limit_mm];
    let turn = |drift: &Drift| [drift.turn_deg, drift.turn_sigma_deg, drift.turn_limit_deg];
    format!(
        "<div class=\"plots\">{}{}</div>\n<p class=\"caption\">A dot for each camera with its standard deviation, and a \
         stroke at its limit. Orange: beyond one of its limits.</p>\n",
        chart(comparison, "shift, mm", &shift),
        chart(comparison, "turn, degrees", &turn)
    )
}

fn chart(comparison: &Comparison, label: &str, of: &dyn Fn(&Drift) -> [f64; 3]) -> String {
    let row = |drift: &Drift| {
        let [value, sigma, limit] = of(drift);
        Interval { name: drift.camera.clone(), value, sigma, limit, marked: drift.moved }
    };
    Intervals { label: label.into(), rows: comparison.cameras.iter().map(row).collect() }.svg()
}

/// The rig as it was, and those cameras that moved where they are now, farther away than they are.
fn before_and_after(earlier: &RigFile, comparison: &Comparison) -> String {
    let both: Vec<(&RigCamera, Pose, &Drift)> = comparison
        .cameras
        .iter()
        .filter_map(|drift| {
            let camera = earlier.camera(&drift.camera)?;
            Some((camera, camera.pose?, drift))
        })
        .collect();
    let centres: Vec<DVec3> = both.iter().map(|(_, pose, _)| pose.centre()).collect();
    let Some((_, reach)) = extent(&centres) else { return String::new() };
    let most = |of: &dyn Fn(&Drift) -> f64| comparison.moved().map(of).fold(0.0, f64::max);
    let shift = factor(1e3 * LONGEST * reach, most(&|drift| drift.shift_mm));
    let turn = factor(WIDEST_DEG, most(&|drift| drift.turn_deg));
    let shown = |camera: &'static str, name, intrinsics, pose| Shown { name, class: camera, intrinsics, pose };
    let mut cameras: Vec<Shown<'_>> =
        both.iter().map(|(camera, pose, _)| shown("before", &camera.name, &camera.intrinsics, *pose)).collect();
    for (camera, pose, drift) in both.iter().filter(|(_, _, drift)| drift.moved) {
        cameras.push(shown("after", "", &camera.intrinsics, exaggerated(pose, &drift.now, shift, turn)));
    }
    let caption = if comparison.moved().next().is_some() {
        format!(
            "Drag to turn. Blue: where the cameras were; orange: where those that moved are, shifts drawn {} times and turns \
             {} times as large as they are.",
            number(shift, 0),
            number(turn, 0)
        )
    } else {
        "Drag to turn. None moved.".into()
    };
    drawing(&Scene { cameras: &cameras, outlines: &[], metric: None }, &caption)
}

/// By how much `value` is enlarged, so that it is `wanted` at most: a round factor, never less than 1.
fn factor(wanted: f64, value: f64) -> f64 {
    if value > 0.0 { round_down((wanted / value).max(1.0)) } else { 1.0 }
}

/// A pose that is so many times farther from `before` than `now` is.
fn exaggerated(before: &Pose, now: &Pose, shift: f64, turn: f64) -> Pose {
    let turned = (now.rotation * before.rotation.conjugate()).to_scaled_axis();
    let rotation = (DQuat::from_scaled_axis(turned * turn) * before.rotation).normalize();
    let centre = before.centre() + (now.centre() - before.centre()) * shift;
    Pose { rotation, translation: -(rotation * centre) }
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics, Modality};

    use super::*;
    use crate::check::{Tolerance, compare};

    fn rig() -> RigFile {
        let intrinsics =
            Intrinsics { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0, distortion: Distortion::None };
        let cameras = (0..5).map(|i| {
            let eye = DVec3::new(2.0 * f64::from(i).sin(), -0.3, 2.0 * f64::from(i).cos());
            let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Y);
            RigCamera::new(&format!("<c{i}>"), Modality::Rgb, intrinsics, Some(pose))
        });
        RigFile::new("wand", true, cameras.collect())
    }

    #[test]
    fn the_page_names_the_camera_that_moved_and_draws_it_farther_away() {
        let mut later = rig();
        let pose = later.cameras[3].pose.unwrap();
        let eye = pose.centre() + DVec3::new(0.0, 0.012, 0.0);
        let rotation = DQuat::from_rotation_x(0.01) * pose.rotation;
        later.cameras[3].pose = Some(Pose { rotation, translation: -(rotation * eye) });
        let comparison = compare(&rig(), &later, Tolerance::default()).unwrap();
        let page = drift_page(&rig(), &comparison);
        assert!(page.contains("<b>&lt;c3&gt;</b> moved; the other 4 cameras") && !page.contains("<c3>"));
        assert!(page.contains("12.00 ± 0.00") && page.contains("0.573 ± 0.000"));
        // 35 % of some 2 m is 50 times and more of 12 mm; 15 degrees are 26 times 0.57.
        assert!(page.contains("shifts drawn 50 times and turns 20 times"), "{page}");
        assert_eq!((page.matches("class=\"before\"").count(), page.matches("class=\"after\"").count()), (5, 1));
    }

    #[test]
    fn a_rig_that_stands_as_it_was_and_two_cameras_without_a_majority_have_pages_too() {
        let same = compare(&rig(), &rig(), Tolerance::default()).unwrap();
        let page = drift_page(&rig(), &same);
        assert!(page.contains("None of 5 cameras") && !page.contains("class=\"after\"") && !page.contains("NaN"));
        let (mut two, mut later) = (rig(), rig());
        two.cameras.truncate(2);
        two.metric = false;
        later.cameras[1].pose.as_mut().unwrap().translation.y += 0.02;
        let page = drift_page(&two, &compare(&two, &later, Tolerance::default()).unwrap());
        assert!(page.contains("Cameras moved relative to each other") && page.contains("Too few cameras agree"));
        assert!(page.contains("Not compared") && page.contains("no scale"));
    }
}
