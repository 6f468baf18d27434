//! All cameras together: boards that were seen at the same instant are one board.

use std::collections::BTreeMap;

use glam::DVec2;

use super::{
    BoardError, BoardOptions, BoardView, Plate, Seen,
    alone::Alone,
    back,
    chain::{Boards, Chain},
    intrinsics::{board_pose, mark_gross, observations, spread},
    link::{BackPose, Sightings},
    plate::Face,
};
use crate::{
    bundle::{Bundle, BundleCamera, Loss, Options, Parameter, Placement, Solution},
    evidence::Moment,
};

/// The solved problem of all cameras.
pub(super) struct Joint {
    pub bundle: Bundle,
    /// When each board was seen.
    pub moments: Vec<Moment>,
    /// The side in whose frame each board's pose is: the front where it is known where the back is.
    pub faces: Vec<Face>,
    /// The passes of the solver, by name.
    pub passes: Vec<(&'static str, Solution)>,
    /// Whether time offsets were estimated.
    pub timed: bool,
}

/// Each camera's boards, as it saw them.
pub(super) fn sightings(seen: &[&Seen], plate: &Plate, alone: &[&Alone]) -> Vec<Sightings> {
    let sighting = |view: &BoardView, alone: &Alone| {
        let pose = board_pose(view, plate, &alone.intrinsics)?;
        Some((view.instant.clone(), (plate.face(view), pose)))
    };
    let of = |(seen, alone): (&&Seen, &&Alone)| {
        let views = seen.views.iter().filter(|view| spread(view));
        views.filter_map(|view| sighting(view, alone)).collect()
    };
    seen.iter().zip(alone).map(of).collect()
}

/// Whether all frames have times, so that offsets can be estimated.
pub(super) fn has_times(seen: &[&Seen]) -> bool {
    seen.iter().all(|seen| seen.views.iter().all(|view| view.time_s.is_some()))
}

/// The cameras of a chain, which `seen`, `alone` and `boards` have an entry each of.
#[derive(Clone, Copy)]
pub(super) struct Tied<'a> {
    pub seen: &'a [&'a Seen],
    pub plate: &'a Plate,
    pub alone: &'a [&'a Alone],
    pub chain: &'a Chain,
    pub boards: &'a [Boards],
    /// Where the board's back is, where that is known.
    pub back: Option<BackPose>,
}

/// Solves for all cameras of a chain.
pub(super) fn solve(tied: Tied<'_>, options: &BoardOptions) -> Result<Joint, BoardError> {
    let timed = options.time_offsets && has_times(tied.seen);
    let (mut bundle, moments, faces) = problem(tied, options, timed);
    let first = bundle.solve(&Options { loss: Loss::Cauchy(3.0), ..Options::default() })?;
    mark_gross(&mut bundle);
    let last = bundle.solve(&Options::default())?;
    let passes = vec![("all cameras, robust", first), ("all cameras", last)];
    Ok(Joint { bundle, moments, faces, passes, timed })
}

fn problem(tied: Tied<'_>, options: &BoardOptions, timed: bool) -> (Bundle, Vec<Moment>, Vec<Face>) {
    let Tied { seen, plate, alone, chain, boards, back } = tied;
    let mut bundle = Bundle::default();
    let side = back.zip(plate.back());
    bundle.sides.extend(side.map(|(back, target)| back::side(target, back.pose, back.seen && !back.stated)));
    let poses = &chain.poses;
    for (index, ((seen, alone), pose)) in seen.iter().zip(alone).zip(poses).enumerate() {
        let mut free = Vec::new();
        if alone.single.is_some() && !options.keep_intrinsics {
            free = options.lens_parameters();
        }
        if index > 0 {
            free.extend(Parameter::POSE);
            if timed {
                free.push(Parameter::TimeOffset);
            }
        }
        let (name, intrinsics) = (seen.camera.clone(), alone.intrinsics);
        bundle.cameras.push(BundleCamera { name, intrinsics, pose: *pose, time_offset_s: 0.0, free });
    }
    let mut placements: BTreeMap<(Face, String), (usize, Option<f64>)> = BTreeMap::new();
    let (mut moments, mut faces) = (Vec::new(), Vec::new());
    for (index, seen) in seen.iter().enumerate() {
        for (number, view) in seen.views.iter().enumerate() {
            let face = plate.face(view);
            // In the frame of the front, if it is known where that is.
            let key = (if side.is_some() { Face::Front } else { face }, view.instant.clone());
            let Some(board) = boards[index].get(&key) else { continue };
            let (placement, time_s) = *placements.entry(key.clone()).or_insert_with(|| {
                bundle.placements.push(Placement::Board(board.then(&poses[index].inverse())));
                moments.push(view.moment());
                faces.push(key.0);
                (bundle.placements.len() - 1, view.time_s)
            });
            // To the instant's time, at the speed at which each corner moves across the image.
            let late = view.time_s.zip(time_s).map_or(0.0, |(own, shared)| own - shared);
            let around = [number.checked_sub(1).and_then(|before| seen.views.get(before)), seen.views.get(number + 1)];
            for mut observation in observations(view, plate, index, placement, alone[index].sigma_px()) {
                observation.side = side.filter(|_| face == Face::Back).map(|_| 0);
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
    (bundle, moments, faces)
}

/// How fast a corner moves, pixels per second, from the views before and after.
fn velocity(id: u32, view: &BoardView, around: [Option<&BoardView>; 2]) -> DVec2 {
    /// Views farther apart say nothing about the speed.
    const NEAR_S: f64 = 0.5;
    let at = |view: Option<&BoardView>| {
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
