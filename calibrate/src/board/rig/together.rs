//! All cameras of a chain in one world.

use glam::DVec3;

use erfgs_scene::{Modality, rig_file::Sigma};

use super::{
    super::{
        BoardError, Plate,
        back::BackPose,
        doubt::Doubts,
        joint::{self, Joint, Tied, has_times},
        origin,
        plate::Face,
        remedies::{self, Offsets, Refused},
    },
    BoardOptions, Fitted, Outcome,
    alone::modality,
    warnings::{as_stated, coverage_warnings, focal_warning, scattered},
};
use crate::{
    bundle::{
        BundleError, Loss, Placement, Uncertainty,
        jackknife::{MOST_GROUPS, successive},
    },
    evidence::Evidence,
};

/// A solution, what is known of it, and what speaks against it.
struct Solved {
    joint: Joint,
    uncertainty: Uncertainty,
    doubts: Doubts,
}

/// Stretches of a recording of which one is left out at a time, where cameras do not run together.
const STRETCHES: usize = 6;

impl Solved {
    fn of(tied: Tied<'_>, options: &BoardOptions) -> Result<Self, BoardError> {
        let mut joint = joint::solve(tied, options)?;
        if let Some(name) = &options.origin {
            origin::put(&mut joint, tied.plate, name)?;
        }
        // What a track leaves over is alike for some frames, and how late they come wanders: what is left out in turn must be long.
        let most = if joint.timed { STRETCHES } else { MOST_GROUPS };
        let groups = successive(joint.bundle.placements.len(), most);
        let uncertainty = joint.bundle.uncertainty_of_groups(Loss::Squared, &groups)?;
        let doubts = Doubts::of(&joint, tied.alone, &uncertainty);
        Ok(Self { joint, uncertainty, doubts })
    }
}

/// All cameras of a chain in one world; with time offsets where the frames' times and their corners say that they are needed.
pub(super) fn together(tied: Tied<'_>, options: &BoardOptions) -> Result<Outcome, BoardError> {
    let Tied { seen, plate, alone, .. } = tied;
    let mut notes = Vec::new();
    let untimed = Solved::of(tied, options);
    let doubtful = match &untimed {
        Ok(solved) => !solved.doubts.is_empty() && !solved.joint.timed,
        Err(error) => out_of_bounds(error).is_some() && !options.time_offsets,
    };
    let timed = (doubtful && has_times(seen))
        .then(|| Solved::of(tied, &BoardOptions { time_offsets: true, ..options.clone() }))
        .and_then(Result::ok)
        .filter(|timed| timed.uncertainty.open.is_empty());
    let mut offsets = None;
    let solved = match (untimed, timed) {
        (Err(error), None) => {
            // What contradicts itself may drive a lens out of bounds.
            let Some(what) = out_of_bounds(&error) else { return Err(error) };
            return Ok(Outcome::Refused(Box::new(Refused { what: vec![what], ..Refused::default() })));
        }
        (Err(_), Some(timed)) => timed,
        (Ok(untimed), None) => untimed,
        (Ok(untimed), Some(timed)) => {
            let tried = Offsets::of(&untimed.joint, &timed.joint);
            let better = timed.doubts.gravest < untimed.doubts.gravest && tried.left_px[1] < tried.left_px[0];
            if better {
                notes.push(format!("the cameras do not run together: {}", tried.sentence()));
            }
            offsets = Some(tried);
            if better { timed } else { untimed }
        }
    };
    let Solved { joint, uncertainty, doubts } = solved;
    let free = joint.bundle.sides.first().zip(uncertainty.sides.first()).filter(|(side, _)| side.free);
    let back_pose = free.and_then(|(side, known)| BackPose::of(plate, side, known));
    if let Some(back_pose) = back_pose.as_ref().filter(|back_pose| back_pose.vagueness() > 1.0) {
        return Ok(Outcome::BackOpen(back_pose.uncertainty()));
    }
    let modalities: Vec<Modality> = seen.iter().map(|seen| modality(seen)).collect();
    let mut rig = joint.bundle.rig("board", &uncertainty, &modalities);
    if let Some(open) = rig.quality.as_ref().and_then(|quality| quality.open.first()) {
        return Err(BoardError::Open { what: open.clone() });
    }
    if options.time_offsets && !joint.timed {
        notes.push("time offsets were asked for and not estimated: not all frames have times (timestamps.csv)".into());
    }
    if !doubts.is_bearable() {
        let worst = remedies::worst(&joint);
        let (timed, has_times) = (joint.timed, has_times(seen));
        let mut what = causes(tied, options, timed);
        what.extend(doubts.sentences().into_iter().filter(|sentence| !what.contains(sentence)).collect::<Vec<_>>());
        return Ok(Outcome::Refused(Box::new(Refused { what, offsets, timed, has_times, worst })));
    }
    let doubtful = !doubts.is_empty();
    rig.warnings = doubts.sentences();
    rig.warnings.extend(notes);
    rig.warnings.extend(scattered(&joint));
    rig.warnings.extend(back_pose.as_ref().and_then(BackPose::warning));
    rig.warnings.extend(as_stated(&tied, options));
    for ((camera, one), seen) in rig.cameras.iter_mut().zip(alone).zip(seen) {
        camera.warnings = coverage_warnings(seen);
        // Intrinsics that the last pass kept are as uncertain as the pass before left them.
        if let (true, Some(single)) = (options.keep_intrinsics, &one.single) {
            let alone = single.bundle.rig("board", &single.uncertainty, &[Modality::Rgb]);
            let before = alone.cameras.into_iter().next().and_then(|camera| camera.sigma);
            camera.sigma.get_or_insert_with(Sigma::default).intrinsics = before.unwrap_or_default().intrinsics;
        }
        camera.warnings.extend(focal_warning(camera));
    }
    let mut evidence = Evidence::default();
    for (seen, alone) in seen.iter().zip(alone) {
        if let (Some(_), Some(solution)) = (&alone.single, &alone.solution) {
            evidence.pass(format!("intrinsics of {}", seen.camera), solution);
        }
    }
    for (name, solution) in &joint.passes {
        evidence.pass(*name, solution);
    }
    evidence.observe(&joint.bundle);
    evidence.outlines = outlines(&joint, plate);
    evidence.tables.extend(back_pose.as_ref().map(BackPose::table));
    evidence.moments = joint.moments;
    if let Some(quality) = &mut rig.quality {
        quality.measures.insert("instants".into(), evidence.moments.len() as f64);
        quality.measures.extend(back_pose.iter().flat_map(BackPose::measures));
    }
    Ok(Outcome::Rig(Box::new(Fitted { calibrated: (rig, evidence), doubtful })))
}

/// What a contradiction comes from, in words, as it shows where lenses do not bend to hide it.
fn causes(tied: Tied<'_>, options: &BoardOptions, timed: bool) -> Vec<String> {
    let rigid = BoardOptions { keep_intrinsics: true, time_offsets: timed, ..options.clone() };
    Solved::of(tied, &rigid).map_or(Vec::new(), |solved| solved.doubts.causes().collect())
}

/// What drove a lens out of bounds, in words, if that is what went wrong.
fn out_of_bounds(error: &BoardError) -> Option<String> {
    match error {
        BoardError::Bundle(BundleError::Camera { camera, .. }) => {
            Some(format!("no lens of {camera} makes the views fit together"))
        }
        _ => None,
    }
}

/// Where the boards were, some of them.
fn outlines(joint: &Joint, plate: &Plate) -> Vec<[DVec3; 4]> {
    const MOST: usize = 60;
    let placements = &joint.bundle.placements;
    let every = placements.len().div_ceil(MOST).max(1);
    let outline = |(placement, face): (&Placement, &Face)| {
        let target = plate.target(*face);
        let (columns, rows) = target.corners();
        let corners = [0, columns - 1, columns * rows - 1, columns * (rows - 1)].map(|id| target.point(id));
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { return None };
        Some([a, b, c, d].map(|corner| placement.world(corner)))
    };
    placements.iter().zip(&joint.faces).step_by(every).filter_map(outline).collect()
}
