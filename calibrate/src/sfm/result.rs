//! The rig file and its evidence.

use erfgs_scene::{ImageRgb8, Modality};
use glam::DVec3;

use super::{CameraView, Doubt, SfmError, State, agree::Agreement, refine::Adjusted, run::Run};
use crate::{
    bundle::{Bundle, BundleError, Loss, Parameter, Uncertainty, clusters::boxes},
    evidence::{Evidence, Picture, Table},
};
use erfgs_scene::rig_file::{RigCamera, RigFile};

/// A camera that shares points with fewer others hangs on them.
const FEWEST_NEIGHBOURS: usize = 3;

/// Names of views, with commas.
pub(super) fn names(views: &[CameraView], chosen: impl IntoIterator<Item = usize>) -> String {
    let names: Vec<&str> = chosen.into_iter().map(|view| views[view].name.as_str()).collect();
    names.join(", ")
}

/// What each run came to, in a few words.
pub(super) fn runs_in_words(runs: &[Run]) -> String {
    let word = |run: &Run| {
        let placed = run.cameras.iter().flatten().count();
        format!(
            "{}: {placed} cameras and {} points in the largest of {} models",
            run.name,
            run.points,
            1 + run.others.len()
        )
    };
    runs.iter().map(word).collect::<Vec<_>>().join("; ")
}

/// Points are divided into so many clusters of neighbours that may share errors. On the Panoptic rig 64 to 1024 give the same.
const CLUSTERS: usize = 512;

/// Of a bundle of points, whose features share errors with their neighbours.
pub(super) fn uncertainty(bundle: &Bundle) -> Result<Uncertainty, BundleError> {
    let points: Vec<DVec3> = bundle.placements.iter().map(|point| point.world(DVec3::ZERO)).collect();
    bundle.uncertainty_of_clusters(Loss::Squared, &boxes(&points, CLUSTERS.min(points.len())))
}

/// The rig that the adjusted bundle stands for, with what is doubtful about it.
pub(super) fn result(
    state: State<'_>,
    agreement: &Agreement,
    doubts: &[Option<Doubt>],
    adjusted: &Adjusted,
    metric: bool,
    version: &str,
) -> Result<(RigFile, Evidence), SfmError> {
    let State { views, options, runs, candidates, mut evidence } = state;
    let bundle = &adjusted.bundle;
    let uncertainty = uncertainty(bundle)?;
    let modalities: Vec<Modality> = adjusted.views.iter().map(|&view| views[view].modality).collect();
    let mut rig = bundle.rig("sfm", &uncertainty, &modalities);
    rig.metric = metric;
    if !metric {
        rig.warnings.push(
            "images alone have no scale: the unit of length is the root mean square distance of the cameras from their \
             middle; give a known distance (--scale-from A:B:METRES) for metres"
                .into(),
        );
    }
    let neighbours = adjusted.neighbours();
    let mut rows = Vec::new();
    for (view, verdict) in agreement.verdicts.iter().enumerate() {
        let run = |run: usize| candidates[run].name.as_str();
        let index = adjusted.views.iter().position(|&adjusted| adjusted == view);
        let mut warnings = Vec::new();
        match &doubts[view] {
            Some(Doubt::Confirmed(number, points)) => warnings.push(format!(
                "the runs disagree on it; it was placed again by {points} points of the other cameras, which agrees with the run \
                 '{}'",
                run(*number)
            )),
            Some(Doubt::Alone(points)) => warnings.push(format!(
                "no two runs agree on it; it was placed by {points} points of the other cameras, which no run confirms"
            )),
            Some(Doubt::Open) => warnings.push(
                "it has no pose: no two runs agree on it, and it sees too few points of the other cameras; add texture to the scene, \
                 move it nearer to its neighbours, or calibrate it with a wand"
                    .into(),
            ),
            None if !verdict.others.is_empty() => {
                let others: Vec<&str> = verdict.others.iter().map(|(number, _)| run(*number)).collect();
                warnings.push(format!("outvoted: the run '{}' puts it elsewhere", others.join("', '")));
            }
            None => {}
        }
        let far = verdict.others.iter().filter_map(|(_, other)| {
            Some(other.pose.centre().distance(verdict.placed.as_ref()?.pose.centre()) / agreement.size)
        });
        let far = far.fold(0.0, f64::max);
        let mut row = vec![
            views[view].name.clone(),
            verdict.alike.len().to_string(),
            verdict.others.len().to_string(),
            format!("{:.3}", 100.0 * verdict.apart),
            if verdict.others.is_empty() { "-".into() } else { format!("{:.1}", 100.0 * far) },
        ];
        match index {
            Some(index) => {
                let camera = &mut rig.cameras[index];
                if camera.observations < options.fewest_points {
                    warnings.push(format!("it is determined by only {} points", camera.observations));
                }
                if neighbours[index] < FEWEST_NEIGHBOURS.min(views.len() - 1) {
                    warnings.push(format!("it shares points with only {} other cameras", neighbours[index]));
                }
                row.extend([camera.observations.to_string(), neighbours[index].to_string()]);
                camera.warnings = warnings;
            }
            None => {
                let known = views[view].intrinsics.or(verdict.placed.map(|placed| placed.intrinsics));
                row.extend(["-".into(), "-".into()]);
                if let Some(intrinsics) = known {
                    let mut camera = RigCamera::new(&views[view].name, views[view].modality, intrinsics, None);
                    camera.warnings = warnings;
                    rig.cameras.push(camera);
                } else {
                    rig.warnings.extend(warnings.into_iter().map(|warning| format!("{}: {warning}", views[view].name)));
                }
            }
        }
        rows.push(row);
    }
    rig.cameras.sort_by_key(|camera| views.iter().position(|view| view.name == camera.name));
    if bundle.cameras.iter().any(|camera| camera.free.contains(&Parameter::Focal)) {
        rig.warnings.push("the intrinsics come from the same images as the poses; a board gives better ones".into());
    }
    let agreed = agreement.verdicts.iter().filter(|verdict| verdict.agreed()).count();
    let points = bundle.placements.len();
    let apart = agreement.verdicts.iter().filter(|verdict| verdict.agreed()).map(|verdict| verdict.apart);
    if let Some(quality) = &mut rig.quality {
        let measures = &mut quality.measures;
        measures.insert("runs".into(), runs.len() as f64);
        measures.insert("cameras_that_runs_agree_on".into(), agreed as f64);
        measures.insert("points".into(), points as f64);
        measures.insert("largest_difference_between_runs_percent".into(), 100.0 * apart.fold(0.0, f64::max));
    }
    evidence.tables.push(table_of_runs(&runs, version));
    let head = ["camera", "runs alike", "runs elsewhere", "apart %", "elsewhere %", "observations", "neighbours"];
    evidence.tables.push(Table {
        title: "Agreement between runs".into(),
        note: "Distances as share of the arrangement's size: among the runs that are alike, and of those that put the camera \
               elsewhere. Neighbours share at least ten points."
            .into(),
        head: head.map(String::from).to_vec(),
        rows,
    });
    evidence.observe(bundle);
    renumber(&mut evidence, &rig, adjusted, views);
    evidence.pictures = pictures(&rig, views);
    Ok((rig, evidence))
}

/// The views' images, for the cameras that have a pose.
pub(super) fn pictures<'a>(rig: &RigFile, views: impl IntoIterator<Item = &'a CameraView>) -> Vec<Picture> {
    let of = |view: &CameraView| {
        let placed = |camera: &RigCamera| camera.name == view.name && camera.pose.is_some();
        let (width, height) = (view.image.width, view.image.height);
        let data = view.image.data.iter().flat_map(|grey| [*grey; 3]).collect();
        Some(Picture::new(rig.cameras.iter().position(placed)?, None, &ImageRgb8 { width, height, data }))
    };
    views.into_iter().filter_map(of).collect()
}

/// Residuals count cameras as the rig does.
fn renumber(evidence: &mut Evidence, rig: &RigFile, adjusted: &Adjusted, views: &[CameraView]) {
    let place = |view: usize| rig.cameras.iter().position(|camera| camera.name == views[view].name).unwrap_or(0);
    let places: Vec<usize> = adjusted.views.iter().map(|&view| place(view)).collect();
    for residual in &mut evidence.residuals {
        residual.camera = places[residual.camera];
    }
}

fn table_of_runs(runs: &[Run], version: &str) -> Table {
    let row = |run: &Run| {
        vec![
            run.name.clone(),
            run.features.iter().map(|features| features.positions.len()).sum::<usize>().to_string(),
            run.cameras.iter().flatten().count().to_string(),
            run.points.to_string(),
            format!("{:.3}", run.error_px),
            format!("{:.1}", run.seconds),
        ]
    };
    Table {
        title: "Runs".into(),
        note: format!("{version}; the largest model of each run, before our own adjustment."),
        head: ["run", "features", "cameras", "points", "error px", "seconds"].map(String::from).to_vec(),
        rows: runs.iter().map(row).collect(),
    }
}
