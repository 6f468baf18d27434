//! What a calibration by wand hands on: the rig, what is doubtful about it, and the evidence.

use super::{WandCamera, WandError, WandOptions, adjust::Scatter, held_out};
use crate::{
    bundle::{Bundle, Parameter, Uncertainty},
    evidence::{Evidence, Table},
};
use erfgs_scene::rig_file::RigFile;

/// A camera that loses more of its observations as outliers is doubtful.
const OUTLIERS: f64 = 0.25;
/// Residuals this many times what they are said to scatter by are doubtful.
const EXCESS: f64 = 1.5;
/// A focal length that moved by this many of its standard deviations beforehand is doubtful.
const FOCAL: f64 = 1.5;

/// A centre less certain than this share of the distance to the wands that its camera saw is none.
const VAGUE: f64 = 0.05;
/// A direction less certain than this is none, degrees.
const VAGUE_DEG: f64 = 2.0;

/// How many placements each camera sees with two LEDs or more that take part.
pub(super) fn placements(bundle: &Bundle) -> Vec<usize> {
    let mut leds = vec![vec![0_u8; bundle.placements.len()]; bundle.cameras.len()];
    for observation in bundle.observations.iter().filter(|o| o.used) {
        leds[observation.camera][observation.placement] += 1;
    }
    leds.iter().map(|camera| camera.iter().filter(|leds| **leds >= 2).count()).collect()
}

/// The rig and its evidence.
///
/// # Errors
/// If parameters are left open, by name.
pub(super) fn outcome(
    cameras: &[WandCamera],
    bundle: Bundle,
    uncertainty: &Uncertainty,
    scatter: &[Scatter],
    mut evidence: Evidence,
    options: &WandOptions,
) -> Result<(RigFile, Evidence), WandError> {
    let modalities: Vec<_> = cameras.iter().map(|camera| camera.modality).collect();
    let mut rig = bundle.rig("wand", uncertainty, &modalities);
    let mut open = rig.quality.as_ref().map_or(Vec::new(), |quality| quality.open.clone());
    if open.is_empty() {
        open = vague(&bundle, uncertainty);
    }
    if !open.is_empty() {
        return Err(WandError::Open { what: open });
    }
    let measures = &mut rig.quality.get_or_insert_default().measures;
    let seen = placements(&bundle);
    measures.insert("placements".into(), bundle.placements.len() as f64);
    for (what, name) in [("first gap", "first_gap"), ("second gap", "second_gap"), ("whole wand", "whole_wand")] {
        let Some((mean, rms, count)) = held_out::errors_mm(&evidence.held_out, what) else { continue };
        measures.insert(format!("held_out_{name}_mean_mm"), mean);
        measures.insert(format!("held_out_{name}_rms_mm"), rms);
        measures.insert(format!("held_out_{name}_count"), count as f64);
        let known = evidence.held_out.iter().find(|l| l.what == what).map_or(1.0, |l| 1e3 * l.known_m);
        if mean.abs() > 4.0 * rms / (count as f64).sqrt() && mean.abs() > 0.003 * known {
            rig.warnings.push(format!(
                "the {what} is {mean:+.2} mm off on average in {count} held-out placements: check the wand's gaps, their \
                 order, and the cameras' intrinsics"
            ));
        }
    }
    for (index, (camera, state)) in rig.cameras.iter_mut().zip(&bundle.cameras).enumerate() {
        let share = camera.outliers as f64 / (camera.observations + camera.outliers).max(1) as f64;
        if share > OUTLIERS {
            camera.warnings.push(format!("{:.0} % of its observations are outliers", 100.0 * share));
        }
        if seen[index] < 20 && !options.keeps(&camera.name) {
            camera.warnings.push(format!("it is determined by only {} placements", seen[index]));
        }
        let (known, found) = (cameras[index].intrinsics.fx, state.intrinsics.fx);
        if !options.fix_focal && (found / known - 1.0).abs() > FOCAL * options.focal_sigma {
            let share = 100.0 * (found / known - 1.0);
            camera
                .warnings
                .push(format!("its focal length is {share:+.1} % from what was known: check its intrinsics"));
        }
        let sigma = scatter[index];
        if let Some(rms) = camera.rms_px.filter(|rms| sigma.known && *rms > EXCESS * sigma.sigma_px * 2_f64.sqrt()) {
            camera.warnings.push(format!(
                "its residuals (rms {rms:.2} px in two dimensions) exceed its stated standard deviation of {} px",
                sigma.sigma_px
            ));
        }
    }
    evidence.observe(&bundle);
    evidence.tables.push(camera_table(&bundle, uncertainty, scatter, &rig, &seen));
    evidence.tables.push(together(&bundle));
    Ok((rig, evidence))
}

/// Poses that the placements leave open within the scatter of what was seen, in words. Of a camera before which the wand rested,
/// say, noise alone tells how it is turned about the wand: that is no open direction of the equations, but as good as one.
fn vague(bundle: &Bundle, uncertainty: &Uncertainty) -> Vec<String> {
    let mut seen = vec![(0.0, 0_usize); bundle.cameras.len()];
    for observation in bundle.observations.iter().filter(|o| o.used) {
        let wand = bundle.placements[observation.placement].world(observation.on_target);
        let (sum, count) = &mut seen[observation.camera];
        *sum += wand.distance(bundle.cameras[observation.camera].pose.centre());
        *count += 1;
    }
    let free: Vec<usize> = (0..bundle.cameras.len())
        .filter(|&index| bundle.cameras[index].free.contains(&Parameter::Rotation(0)))
        .collect();
    let describe = |index: usize| {
        let known = &uncertainty.cameras[index];
        let centre_m = (known.centre.col(0).x + known.centre.col(1).y + known.centre.col(2).z).sqrt();
        let (turn_deg, distance_m) =
            (known.rotation.max_element().to_degrees(), seen[index].0 / seen[index].1.max(1) as f64);
        (centre_m > VAGUE * distance_m || turn_deg > VAGUE_DEG).then(|| {
            format!("(centre ± {centre_m:.2} m at {distance_m:.1} m from the wand, direction ± {turn_deg:.1} degrees)")
        })
    };
    let vague: Vec<(usize, String)> = free.iter().filter_map(|&index| Some((index, describe(index)?))).collect();
    // Where none of several stands to the reference, it is the reference that stands to none.
    let reference = bundle.cameras.iter().find(|camera| !camera.free.contains(&Parameter::Rotation(0)));
    match (reference, vague.as_slice()) {
        (Some(reference), [(first, how), _, ..]) if vague.len() + 1 == bundle.cameras.len() => {
            vec![format!("how {} stands to the others, such as {} {how}", reference.name, bundle.cameras[*first].name)]
        }
        _ => vague.iter().map(|(index, how)| format!("the pose of {} {how}", bundle.cameras[*index].name)).collect(),
    }
}

fn camera_table(
    bundle: &Bundle,
    uncertainty: &Uncertainty,
    scatter: &[Scatter],
    rig: &RigFile,
    seen: &[usize],
) -> Table {
    let head = [
        "camera",
        "placements",
        "outliers",
        "rms px",
        "sigma px",
        "centre sigma mm",
        "rotation sigma deg",
        "focal sigma px",
        "time offset ms",
    ];
    let rows = rig.cameras.iter().enumerate().map(|(index, camera)| {
        let (state, known) = (&bundle.cameras[index], &uncertainty.cameras[index]);
        let sigma = |parameter| state.free.iter().position(|p| *p == parameter).map(|at| known.sigma[at]);
        let centre = known.centre.col(0).x + known.centre.col(1).y + known.centre.col(2).z;
        let pose = state.free.contains(&Parameter::Rotation(0));
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".into());
        vec![
            camera.name.clone(),
            seen[index].to_string(),
            camera.outliers.to_string(),
            or_dash(camera.rms_px.map(|rms| format!("{rms:.3}"))),
            format!("{:.3}", scatter[index].sigma_px),
            or_dash(pose.then(|| format!("{:.3}", 1e3 * centre.sqrt()))),
            or_dash(pose.then(|| format!("{:.4}", known.rotation.max_element().to_degrees()))),
            or_dash(sigma(Parameter::Focal).map(|sigma| format!("{sigma:.3}"))),
            or_dash(sigma(Parameter::TimeOffset).map(|s| format!("{:.3} ± {:.3}", 1e3 * state.time_offset_s, 1e3 * s))),
        ]
    });
    Table {
        title: "Cameras".into(),
        note: "The world is the frame of the reference camera, which therefore has no uncertainty. The sigma of a centre is the root \
        of the sum of its three variances; that of a rotation is the largest of the three."
            .into(),
        rows: rows.collect(),
        head: head.map(str::to_owned).to_vec(),
    }
}

/// How many placements each two cameras saw together.
fn together(bundle: &Bundle) -> Table {
    let count = bundle.cameras.len();
    let mut seen = vec![vec![false; count]; bundle.placements.len()];
    for observation in bundle.observations.iter().filter(|o| o.used) {
        seen[observation.placement][observation.camera] = true;
    }
    let names = || bundle.cameras.iter().map(|camera| camera.name.clone());
    let row = |a: usize| {
        let shared = (0..count).map(|b| seen.iter().filter(|seen| seen[a] && seen[b]).count().to_string());
        std::iter::once(bundle.cameras[a].name.clone()).chain(shared).collect()
    };
    Table {
        title: "Placements that two cameras saw together".into(),
        note: "On the diagonal: those that a camera saw.".into(),
        head: std::iter::once(String::new()).chain(names()).collect(),
        rows: (0..count).map(row).collect(),
    }
}
