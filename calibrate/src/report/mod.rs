//! The report of a calibration: one HTML file.

mod cameras;
mod choose;
mod drift;
mod enough;
mod events;
mod overlays;
mod pairs;
mod placements;
mod previews;
mod residuals;
mod rig;
mod space;

use std::path::Path;

use erfgs_base::{FileError, atomic};
use erfgs_page::{
    html::{self, Escaped, number},
    plot::{self, Plot, Series},
};

pub use choose::telling;
pub use drift::{drift_page, write_drift};
pub use events::EventHistogram;

use crate::evidence::{Evidence, Pass, Table};
use erfgs_scene::rig_file::RigFile;

/// Writes the report of a calibration to `path`.
///
/// # Errors
/// If the file cannot be written.
pub fn write(rig: &RigFile, evidence: &Evidence, path: &Path) -> Result<(), FileError> {
    atomic::write(path, page(rig, evidence).as_bytes()).map_err(FileError::when("write the report", path))
}

/// The page.
#[must_use]
pub fn page(rig: &RigFile, evidence: &Evidence) -> String {
    let section = |id: &str, heading: &str, body: String| html::section("", id, heading, &body);
    let body = [
        section("cameras", "Cameras", cameras::tables(rig)),
        section("enough", "What it is good enough for", enough::table(rig)),
        section("rig", "Where they stand", rig::picture(rig, &evidence.outlines)),
        section("residuals", "Residuals", residuals::maps(rig, evidence)),
        section("pictures", "Pictures, and without distortion", previews::figures(rig, evidence)),
        section("epipolar", "Epipolar lines", overlays::figures(rig, evidence)),
        section("placements", "Placements that fit worst", placements::table(evidence)),
        section("held-out", "Lengths that took no part", held_out(evidence)),
        section("passes", "Error against solver time", passes(&evidence.passes)),
        evidence.tables.iter().map(table).collect(),
    ];
    html::page(&format!("Calibration of {} cameras", rig.cameras.len()), &head(rig), &styled(&body.concat()))
}

/// A page's body with the style of reports.
fn styled(body: &str) -> String {
    format!("<style>\n{}</style>\n{body}", include_str!("style.css"))
}

/// The greatest of 1, 2, 5, 10, 20, 50 and so on, and of 0.5, 0.2, 0.1 and so on, that is not above `value`; 1 where that is not
/// positive.
fn round_down(value: f64) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 1.0;
    }
    let decade = 10f64.powf(value.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|step| step * decade).find(|step| *step <= value).unwrap_or(decade)
}

fn head(rig: &RigFile) -> String {
    // What speaks against the result comes before it.
    let doubts: String = rig.warnings.iter().map(|warning| format!("<li>{}</li>", Escaped(warning))).collect();
    let mut text =
        if doubts.is_empty() { String::new() } else { format!("<div class=\"notes first\"><ul>{doubts}</ul></div>\n") };
    text += &format!("<p>Method: {}", Escaped(&rig.method));
    if let Some(quality) = &rig.quality {
        let condition = quality.condition.map_or("infinite".into(), |c| format!("{c:.1e}"));
        text += &format!(
            "; root mean square residual <b>{} px</b>, variance factor {}, {} degrees of freedom, condition number {condition}",
            number(quality.rms_px, 3),
            number(quality.variance_factor, 2),
            html::count(quality.degrees_of_freedom as u64),
        );
    }
    text += if rig.metric { ".</p>\n" } else { ". <b>No scale: lengths are not metres.</b></p>\n" };
    let mut notes = Vec::new();
    if let Some(quality) = &rig.quality {
        notes.extend(quality.open.iter().map(|open| format!("Not determined: {}", Escaped(open))));
        let measures = quality.measures.iter().map(|(name, value)| measure(name, *value));
        let measures: Vec<String> = measures.map(|text| Escaped(&text).to_string()).collect();
        if !measures.is_empty() {
            text += &format!("<p>{}</p>\n", measures.join("; "));
        }
    }
    for camera in &rig.cameras {
        notes.extend(camera.warnings.iter().map(|w| format!("<b>{}</b>: {}", Escaped(&camera.name), Escaped(w))));
    }
    if !notes.is_empty() {
        text += &format!("<div class=\"notes\"><ul><li>{}</li></ul></div>\n", notes.join("</li><li>"));
    }
    text
}

/// A measure of the method as people read it: whole numbers without a point, ratios with six significant digits, since they
/// are near 1 and what counts is by how little they are not, and their standard deviations with two.
#[must_use]
pub fn measure(name: &str, value: f64) -> String {
    let significant = |digits: f64| {
        let before = if value == 0.0 { 1.0 } else { value.abs().log10().floor() + 1.0 };
        (digits - before).clamp(0.0, 12.0) as usize
    };
    let digits = match name {
        _ if value.fract() == 0.0 => 0,
        _ if name.contains("_over_") && name.ends_with("_sigma") => significant(2.0),
        _ if name.contains("_over_") => significant(6.0),
        _ => 3,
    };
    format!("{}: {value:.digits$}", name.replace('_', " "))
}

fn held_out(evidence: &Evidence) -> String {
    if evidence.held_out.is_empty() {
        return String::new();
    }
    let mut kinds: Vec<&str> = evidence.held_out.iter().map(|length| length.what.as_str()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let rows = kinds.iter().map(|kind| {
        let of: Vec<_> = evidence.held_out.iter().filter(|length| length.what == *kind).collect();
        let count = of.len() as f64;
        let errors: Vec<f64> = of.iter().map(|length| 1e3 * (length.found_m - length.known_m)).collect();
        let mean = errors.iter().sum::<f64>() / count;
        let rms = (errors.iter().map(|error| error * error).sum::<f64>() / count).sqrt();
        let most = errors.iter().map(|error| error.abs()).fold(0.0, f64::max);
        let known = 1e3 * of.first().map_or(0.0, |length| length.known_m);
        format!(
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
            Escaped(kind),
            of.len(),
            number(known, 2),
            html::difference(mean, 3),
            number(rms, 3),
            number(most, 3)
        )
    });
    let head = "<tr><th>Length</th><th>Measured</th><th>Known <small>mm</small></th><th>Mean error <small>mm</small></th>\
                <th>Root mean square <small>mm</small></th><th>Worst <small>mm</small></th></tr>";
    html::table("figures", head, &rows.collect::<String>())
}

fn passes(passes: &[Pass]) -> String {
    let taken = |pass: &Pass| -> Vec<(f64, f64)> {
        pass.steps.iter().filter(|step| step.taken).map(|step| (1e3 * step.seconds, step.rms_px)).collect()
    };
    let series: Vec<Series> = passes
        .iter()
        .enumerate()
        .map(|(run, pass)| Series { name: pass.name.clone(), run, points: taken(pass) })
        .collect();
    let plot = Plot {
        y_label: "root mean square residual, px".into(),
        x_label: "solver time, ms".into(),
        from_zero: true,
        log_y: true,
        series,
        ..Plot::default()
    };
    let rows = passes.iter().map(|pass| {
        let (first, last) = (pass.steps.first(), pass.steps.last());
        let best = pass.steps.iter().rev().find(|step| step.taken);
        format!(
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
            Escaped(&pass.name),
            pass.steps.len().saturating_sub(1),
            number(1e3 * last.map_or(0.0, |step| step.seconds), 1),
            number(first.map_or(0.0, |step| step.rms_px), 3),
            number(best.map_or(0.0, |step| step.rms_px), 3),
        )
    });
    if passes.is_empty() {
        return String::new();
    }
    let legend = plot::legend(passes.iter().enumerate().map(|(run, pass)| (run, pass.name.as_str())));
    let head = "<tr><th>Pass</th><th>Steps</th><th>Time <small>ms</small></th><th>At the start <small>px</small></th>\
                <th>At the end <small>px</small></th></tr>";
    legend + &plot.svg() + &html::table("figures", head, &rows.collect::<String>())
}

fn table(table: &Table) -> String {
    let cells = |cells: &[String], tag: &str| -> String {
        cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", Escaped(cell))).collect()
    };
    let rows: String = table.rows.iter().map(|row| format!("<tr>{}</tr>\n", cells(row, "td"))).collect();
    let body = html::table("figures", &format!("<tr>{}</tr>", cells(&table.head, "th")), &rows);
    let id: String =
        table.title.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
    html::section("", &id, &table.title, &format!("<p>{}</p>\n{body}", Escaped(&table.note)))
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics, Modality, Pose};
    use glam::DVec2;

    use super::*;
    use crate::{
        bundle::Step,
        evidence::{HeldOut, Residual},
    };
    use erfgs_scene::rig_file::{Quality, RigCamera};

    #[test]
    fn a_page_shows_every_part_and_escapes_names() {
        let intrinsics = Intrinsics {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 501.0,
            cx: 320.0,
            cy: 240.0,
            distortion: Distortion::None,
        };
        let mut cameras = vec![RigCamera::new("<a>", Modality::Rgb, intrinsics, Some(Pose::IDENTITY))];
        let away = Pose { translation: glam::DVec3::new(1.0, 0.0, 0.2), ..Pose::IDENTITY };
        cameras.push(RigCamera::new("b", Modality::Event, intrinsics, Some(away)));
        cameras[1].warnings.push("hangs on few points".into());
        let mut rig = RigFile::new("wand", true, cameras);
        rig.quality = Some(Quality { rms_px: 0.31, open: vec!["fx of b".into()], ..Quality::default() });
        let residual = |camera, residual: Option<DVec2>| Residual {
            camera,
            placement: 3,
            on_target: glam::DVec3::ZERO,
            side: None,
            pixel: DVec2::new(100.0, 200.0),
            at_instant: DVec2::new(100.0, 200.0),
            residual,
            used: residual.is_some(),
        };
        let step = |seconds, rms_px| Step { seconds, cost: rms_px, rms_px, lambda: 1.0, taken: true };
        let evidence = Evidence {
            residuals: vec![residual(0, Some(DVec2::new(0.3, -0.2))), residual(1, None)],
            passes: vec![Pass { name: "all cameras".into(), steps: vec![step(0.0, 5.0), step(0.1, 0.3)] }],
            held_out: vec![HeldOut { what: "outer LEDs".into(), known_m: 0.39, found_m: 0.3902 }],
            tables: vec![Table {
                title: "Agreement".into(),
                note: "n".into(),
                head: vec!["h".into()],
                rows: vec![vec!["<r>".into()]],
            }],
            ..Evidence::default()
        };
        let page = page(&rig, &evidence);
        for part in [
            "&lt;a&gt;",
            "hangs on few",
            "fx of b",
            "outer LEDs",
            "+0.200",
            "Agreement",
            "&lt;r&gt;",
            "all cameras",
            "0.310 px",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("<a>") && !page.contains("NaN"));
    }

    #[test]
    fn measures_have_as_many_digits_as_they_mean() {
        assert_eq!(measure("placements", 240.0), "placements: 240");
        assert_eq!(measure("held_out_first_gap_rms_mm", 0.123_456), "held out first gap rms mm: 0.123");
        assert_eq!(measure("rig_length_over_wand", 1.000_412_34), "rig length over wand: 1.00041");
        assert_eq!(measure("rig_length_over_wand", 0.999_587_66), "rig length over wand: 0.999588");
        assert_eq!(measure("rig_length_over_wand", 37.254_312), "rig length over wand: 37.2543");
        assert_eq!(measure("rig_length_over_wand_sigma", 0.000_123_4), "rig length over wand sigma: 0.00012");
    }

    #[test]
    fn a_converted_rig_without_evidence_has_a_page_too() {
        let page = page(&RigFile::new("colmap", false, Vec::new()), &Evidence::default());
        assert!(page.contains("No scale") && !page.contains("Residuals"));
    }
}
