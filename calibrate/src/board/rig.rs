//! All cameras of a rig from the boards that they saw.

use std::collections::BTreeMap;

use erfgs_scene::{Intrinsics, Modality};
use glam::DVec2;

use super::{
    BoardError, LensModel, Seen, Target,
    chain::{Boards, chain},
    intrinsics::{Single, board_pose, median_residual, observations, single},
};
use crate::{
    bundle::{Bundle, BundleCamera, Loss, Options, Parameter, Placement},
    coverage::Coverage,
    evidence::{Evidence, Moment},
};
use erfgs_scene::rig_file::{RigCamera, RigFile, Sigma};

/// How a board calibration is done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoardOptions {
    /// The lens model.
    pub model: LensModel,
    /// Whether fy/fx is held at 1.
    pub square_pixels: bool,
    /// Intrinsics that are known, by camera; they are kept.
    pub known: BTreeMap<String, Intrinsics>,
    /// Whether each camera's time offset is estimated, from frame times and how the board moves.
    pub time_offsets: bool,
    /// Whether the intrinsics found camera by camera are kept while the poses are adjusted.
    pub keep_intrinsics: bool,
}

/// Calibrates every camera alone, then all together where there is more than one. `progress` is told what is done next.
///
/// # Errors
/// If a camera sees too little, or cameras cannot be tied to each other.
pub fn calibrate(
    seen: &[Seen],
    target: &Target,
    options: &BoardOptions,
    progress: &dyn Fn(usize, usize, &str),
) -> Result<(RigFile, Evidence), BoardError> {
    let mut evidence = Evidence::default();
    let mut cameras = Vec::new();
    for (index, seen) in seen.iter().enumerate() {
        progress(index, seen.views.len().max(1), &seen.camera);
        cameras.push(match options.known.get(&seen.camera) {
            Some(intrinsics) => One { intrinsics: *intrinsics, single: None },
            None => {
                let single = single(seen, target, options.model, options.square_pixels)?;
                evidence.pass(format!("intrinsics of {}", seen.camera), &single.solution);
                One { intrinsics: single.bundle.cameras[0].intrinsics, single: Some(single) }
            }
        });
    }
    if let ([one], [camera]) = (seen, cameras.as_slice())
        && let Some(single) = &camera.single
    {
        evidence.observe(&single.bundle);
        evidence.moments.clone_from(&single.moments);
        let mut rig = single.bundle.rig("board", &single.uncertainty, &[modality(one)]);
        // One camera stands nowhere but where it is.
        if let [camera] = rig.cameras.as_mut_slice() {
            camera.pose = None;
            camera.warnings = coverage_warnings(one).into_iter().chain(focal_warning(camera)).collect();
        }
        return Ok((rig, evidence));
    }
    let (mut bundle, moments) = tie(seen, target, options, &cameras)?;
    progress(seen.len(), seen.len(), "all cameras");
    let first = bundle.solve(&Options { loss: Loss::Cauchy(3.0), ..Options::default() })?;
    evidence.pass("all cameras, robust", &first);
    let typical = median_residual(&bundle);
    bundle.mark_outliers(0.0, (8.0 * typical).max(1.0));
    let solution = bundle.solve(&Options::default())?;
    evidence.pass("all cameras", &solution);
    let uncertainty = bundle.uncertainty(Loss::Squared)?;
    evidence.observe(&bundle);
    evidence.moments = moments;
    let modalities: Vec<Modality> = seen.iter().map(modality).collect();
    let mut rig = bundle.rig("board", &uncertainty, &modalities);
    if let Some(open) = rig.quality.as_ref().and_then(|quality| quality.open.first()) {
        return Err(BoardError::Open { what: open.clone() });
    }
    for ((camera, one), seen) in rig.cameras.iter_mut().zip(&cameras).zip(seen) {
        camera.warnings = coverage_warnings(seen);
        // Intrinsics that the last pass kept are as uncertain as the pass before left them.
        if let (true, Some(single)) = (options.keep_intrinsics, &one.single) {
            let alone = single.bundle.rig("board", &single.uncertainty, &[Modality::Rgb]);
            let before = alone.cameras.into_iter().next().and_then(|camera| camera.sigma);
            camera.sigma.get_or_insert_with(Sigma::default).intrinsics = before.unwrap_or_default().intrinsics;
        }
        camera.warnings.extend(focal_warning(camera));
    }
    if let Some(quality) = &mut rig.quality {
        quality.measures.insert("instants".into(), evidence.moments.len() as f64);
    }
    Ok((rig, evidence))
}

fn modality(seen: &Seen) -> Modality {
    if seen.events { Modality::Event } else { Modality::Rgb }
}

struct One {
    intrinsics: Intrinsics,
    single: Option<Single>,
}

/// The problem of all cameras: boards seen at the same instant are one board.
fn tie(
    seen: &[Seen],
    target: &Target,
    options: &BoardOptions,
    cameras: &[One],
) -> Result<(Bundle, Vec<Moment>), BoardError> {
    let boards: Vec<Boards> = seen
        .iter()
        .zip(cameras)
        .map(|(seen, one)| {
            let views = seen.views.iter().filter(|view| view.corners.len() >= 6);
            views.filter_map(|view| Some((view.instant.clone(), board_pose(view, target, &one.intrinsics)?))).collect()
        })
        .collect();
    let names: Vec<String> = seen.iter().map(|seen| seen.camera.clone()).collect();
    let poses = chain(&names, &boards)?;
    let mut bundle = Bundle::default();
    let timed = options.time_offsets && seen.iter().all(|seen| seen.views.iter().all(|view| view.time_s.is_some()));
    for (index, ((name, one), pose)) in names.iter().zip(cameras).zip(&poses).enumerate() {
        let mut free = Vec::new();
        if one.single.is_some() && !options.keep_intrinsics {
            free = options.model.parameters();
            if options.square_pixels {
                free.retain(|parameter| !matches!(parameter, Parameter::Fx | Parameter::Fy));
                free.insert(0, Parameter::Focal);
            }
        }
        if index > 0 {
            free.extend(Parameter::POSE);
            if timed {
                free.push(Parameter::TimeOffset);
            }
        }
        let (name, intrinsics) = (name.clone(), one.intrinsics);
        bundle.cameras.push(BundleCamera { name, intrinsics, pose: *pose, time_offset_s: 0.0, free });
    }
    let sigmas: Vec<f64> = cameras
        .iter()
        .map(|one| one.single.as_ref().map_or(0.3, |s| (s.bundle.rms_px(None).0 / 2f64.sqrt()).max(0.02)))
        .collect();
    let mut placements: BTreeMap<&str, (usize, Option<f64>)> = BTreeMap::new();
    let mut moments = Vec::new();
    for (index, seen) in seen.iter().enumerate() {
        for (number, view) in seen.views.iter().enumerate() {
            let Some(board) = boards[index].get(&view.instant) else { continue };
            let (placement, time_s) = *placements.entry(&view.instant).or_insert_with(|| {
                bundle.placements.push(Placement::Board(board.then(&poses[index].inverse())));
                moments.push(view.moment());
                (bundle.placements.len() - 1, view.time_s)
            });
            // To the instant's time, at the speed at which each corner moves across the image.
            let late = view.time_s.zip(time_s).map_or(0.0, |(own, shared)| own - shared);
            let around = [number.checked_sub(1).and_then(|before| seen.views.get(before)), seen.views.get(number + 1)];
            for mut observation in observations(view, target, index, placement, sigmas[index]) {
                if view.time_s.is_some() {
                    let corner = view.corners.iter().find(|corner| corner.pixel == observation.pixel);
                    let velocity = corner.map_or(DVec2::ZERO, |corner| velocity(corner.id, view, around));
                    observation.pixel -= velocity * late;
                    if timed {
                        observation.velocity = velocity;
                    }
                }
                bundle.observations.push(observation);
            }
        }
    }
    Ok((bundle, moments))
}

/// How fast a corner moves, pixels per second, from the views before and after.
fn velocity(id: u32, view: &super::BoardView, around: [Option<&super::BoardView>; 2]) -> DVec2 {
    /// Views farther apart say nothing about the speed.
    const NEAR_S: f64 = 0.5;
    let at = |view: Option<&super::BoardView>| {
        let view = view?;
        let corner = view.corners.iter().find(|corner| corner.id == id)?;
        Some((view.time_s?, corner.pixel))
    };
    let here = at(Some(view));
    let near = |other: Option<(f64, DVec2)>| other.filter(|o| here.is_some_and(|h| (o.0 - h.0).abs() < NEAR_S));
    let (before, after) = (near(at(around[0])), near(at(around[1])));
    match before.or(here).zip(after.or(here)) {
        Some(((t0, p0), (t1, p1))) if t1 > t0 => (p1 - p0) / (t1 - t0),
        _ => DVec2::ZERO,
    }
}

/// A focal length less certain than this share of it is doubtful.
const DOUBTFUL: f64 = 0.01;

/// Says so where the focal length is doubtful.
fn focal_warning(camera: &RigCamera) -> Option<String> {
    let sigma = (*camera.sigma.as_ref()?.intrinsics.get("fx")?)?;
    let share = sigma / camera.intrinsics.fx;
    (share > DOUBTFUL).then(|| {
        format!(
            "its focal length is known to {:.1} % only, and its poses are no better; show it the board tilted by 30 degrees and \
             more about both axes",
            100.0 * share
        )
    })
}

/// What a camera's views lack.
fn coverage_warnings(seen: &Seen) -> Vec<String> {
    const GRID: usize = 4;
    let mut coverage = Coverage::new(seen.size, [GRID; 2]);
    seen.views.iter().flat_map(|view| &view.corners).for_each(|corner| coverage.see(corner.pixel));
    let (covered, parts) = (coverage.covered(), coverage.parts());
    let mut warnings = Vec::new();
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
