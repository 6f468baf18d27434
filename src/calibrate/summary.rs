//! What every way of calibrating ends with: the rig file, the report, a table.

use std::path::Path;

use erfgs_calibrate::{evidence::Evidence, report};
use erfgs_scene::rig_file::{RigCamera, RigFile};

use crate::terminal::{Terminal, table, thousands};

/// Writes the rig and its report, and prints a summary.
pub fn finish(rig: &RigFile, evidence: &Evidence, out: &Path, terminal: &Terminal) -> anyhow::Result<()> {
    rig.write(out)?;
    let page = out.with_extension("html");
    report::write(rig, evidence, &page)?;
    terminal.result(rig, || {
        // What speaks against the result comes before it.
        let mut text: String = rig.warnings.iter().map(|warning| format!("warning: {warning}\n")).collect();
        if !text.is_empty() {
            text.push('\n');
        }
        text += &table(&rows(rig));
        if let Some(quality) = &rig.quality {
            text.push_str(&format!(
                "\nrms {:.3} px, {} degrees of freedom, condition {}\n",
                quality.rms_px,
                thousands(quality.degrees_of_freedom as u64),
                quality.condition.map_or("infinite".into(), |condition| format!("{condition:.1e}")),
            ));
            for (name, value) in &quality.measures {
                text.push_str(&format!("{}\n", report::measure(name, *value)));
            }
            for open in &quality.open {
                text.push_str(&format!("not determined: {open}\n"));
            }
        }
        for camera in &rig.cameras {
            for warning in &camera.warnings {
                text.push_str(&format!("warning: {}: {warning}\n", camera.name));
            }
        }
        text.push_str(&format!("\n{}\n{}\n", out.display(), page.display()));
        text
    })
}

fn rows(rig: &RigFile) -> Vec<Vec<String>> {
    let with_sigma = |value: f64, sigma: Option<f64>, digits: usize| match sigma {
        Some(sigma) => format!("{value:.digits$} ± {sigma:.digits$}"),
        None => format!("{value:.digits$}"),
    };
    let longest = |sigma: &[Option<f64>; 3], scale: f64, digits: usize| match sigma {
        [Some(x), Some(y), Some(z)] => format!("{:.digits$}", scale * (x * x + y * y + z * z).sqrt()),
        _ => "open".into(),
    };
    let row = |camera: &RigCamera| {
        let sigma = camera.sigma.as_ref();
        let of = |name: &str| sigma.and_then(|sigma| sigma.intrinsics.get(name).copied().flatten());
        let i = &camera.intrinsics;
        vec![
            camera.name.clone(),
            camera.rms_px.map_or("-".into(), |rms| format!("{rms:.3}")),
            thousands(camera.observations as u64),
            thousands(camera.outliers as u64),
            with_sigma(i.fx, of("fx"), 2),
            with_sigma(i.cx, of("cx"), 2),
            with_sigma(i.cy, of("cy"), 2),
            camera.pose.and(sigma).map_or("-".into(), |sigma| longest(&sigma.centre_m, 1e3, 3)),
            camera.pose.and(sigma).map_or("-".into(), |sigma| longest(&sigma.rotation_deg, 1.0, 4)),
            with_sigma(camera.time_offset_s * 1e3, sigma.and_then(|sigma| sigma.time_offset_s).map(|s| s * 1e3), 2),
        ]
    };
    let centre = if rig.metric { "centre ± mm" } else { "centre ± 1/1000" };
    let head = ["camera", "rms px", "observed", "outliers", "fx", "cx", "cy", centre, "turn ± deg", "offset ms"];
    std::iter::once(head.map(String::from).to_vec()).chain(rig.cameras.iter().map(row)).collect()
}
