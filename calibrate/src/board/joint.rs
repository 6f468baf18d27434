//! All cameras together: boards that were seen at the same instant are one board.

use std::collections::BTreeMap;

use super::{
    BoardDetections, BoardError, BoardOptions, BoardView, Plate,
    alone::Alone,
    back,
    chain::{Boards, Chain},
    intrinsics::{board_pose, mark_gross, observations, spread},
    link::{BackPose, Sightings},
    plate::Face,
    scatter,
    track::Track,
};
use crate::{
    bundle::{Bundle, BundleCamera, Loss, Observation, Options, Parameter, Placement, Solution},
    evidence::Moment,
};

/// The solved problem of all cameras.
pub(super) struct Joint {
    pub bundle: Bundle,
    /// When each board was seen.
    pub moments: Vec<Moment>,
    /// The side in whose frame each board's pose is: the front where it is known where the back is.
    pub faces: Vec<Face>,
    /// How fast each observation's view moved across the image, pixels a second or, without times, a frame; `None` where no
    /// view is near it.
    pub speeds: Vec<Option<f64>>,
    /// The passes of the solver, by name.
    pub passes: Vec<(&'static str, Solution)>,
    /// Whether time offsets were estimated.
    pub timed: bool,
    /// The standard deviation of a corner of each camera whose time is known, pixels.
    sigma_px: Vec<f64>,
    /// By how much each camera's frames are off in time beside its offset, seconds (standard deviation).
    pub scatter_s: Vec<f64>,
}

impl Joint {
    /// What an observation leaves over, pixels, beside what not knowing its time explains: less where that widened its deviation.
    pub fn beyond_timing(&self, observation: &Observation) -> Option<f64> {
        let length = self.bundle.residual_px(observation)?.length();
        Some(length * self.sigma_px[observation.camera] / observation.sigma_px)
    }

    /// Root mean square of that over the observations of a camera (or all) that take part, pixels.
    pub fn rms_px(&self, camera: Option<usize>) -> f64 {
        let chosen =
            self.bundle.observations.iter().filter(|o| o.used && camera.is_none_or(|camera| o.camera == camera));
        let (mut sum, mut count) = (0.0, 0.0);
        for left_px in chosen.filter_map(|observation| self.beyond_timing(observation)) {
            sum += left_px * left_px;
            count += 1.0;
        }
        if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 }
    }
}

/// Each camera's boards, as it saw them.
pub(super) fn sightings(seen: &[&BoardDetections], plate: &Plate, alone: &[&Alone]) -> Vec<Sightings> {
    let sighting = |view: &BoardView, alone: &Alone| {
        let pose = board_pose(view, plate, &alone.intrinsics)?;
        Some((view.instant.clone(), (plate.face(view), pose)))
    };
    let of = |(seen, alone): (&&BoardDetections, &&Alone)| {
        let views = seen.views.iter().filter(|view| spread(view));
        views.filter_map(|view| sighting(view, alone)).collect()
    };
    seen.iter().zip(alone).map(of).collect()
}

/// Whether all frames have times, so that offsets can be estimated.
pub(super) fn has_times(seen: &[&BoardDetections]) -> bool {
    seen.iter().all(|seen| seen.views.iter().all(|view| view.time_s.is_some()))
}

/// The cameras of a chain, which `seen`, `alone` and `boards` have an entry each of.
#[derive(Clone, Copy)]
pub(super) struct Tied<'a> {
    pub seen: &'a [&'a BoardDetections],
    pub plate: &'a Plate,
    pub alone: &'a [&'a Alone],
    pub chain: &'a Chain,
    pub boards: &'a [Boards],
    /// Where the board's back is, where that is known.
    pub back: Option<BackPose>,
}

/// Time offsets have settled when none of them changes by more, seconds.
const SETTLED_S: f64 = 5e-4;
/// How often corners are brought to where the offsets found last say.
const MOST_ROUNDS: usize = 6;

/// Solves for all cameras of a chain.
pub(super) fn solve(tied: Tied<'_>, options: &BoardOptions) -> Result<Joint, BoardError> {
    let timed = options.time_offsets && has_times(tied.seen);
    let mut joint = problem(tied, options, timed, &vec![0.0; tied.seen.len()]);
    let robust = Options { loss: Loss::Cauchy(3.0), ..Options::default() };
    joint.passes.push(("all cameras, robust", joint.bundle.solve(&robust)?));
    if timed {
        settle(tied, options, &mut joint, &robust)?;
        joint.scatter_s = scatter::weigh(&mut joint.bundle);
    }
    if joint.scatter_s.iter().any(|scatter| *scatter > 0.0) {
        joint.passes.push(("all cameras, by how surely frames are timed", joint.bundle.solve(&robust)?));
        scatter::mark_gross(&mut joint.bundle);
    } else {
        mark_gross(&mut joint.bundle);
    }
    joint.passes.push(("all cameras", joint.bundle.solve(&Options::default())?));
    Ok(joint)
}

/// A speed tells of an offset as long as that is short. So corners are brought to where the offsets say, and these are estimated
/// anew, until they no longer change.
fn settle(tied: Tied<'_>, options: &BoardOptions, joint: &mut Joint, robust: &Options) -> Result<(), BoardError> {
    let mut known_s = vec![0.0; joint.bundle.cameras.len()];
    for _ in 0..MOST_ROUNDS {
        let found_s: Vec<f64> = joint.bundle.cameras.iter().map(|camera| camera.time_offset_s).collect();
        if found_s.iter().zip(&known_s).all(|(found, known)| (found - known).abs() < SETTLED_S) {
            break;
        }
        let before = std::mem::replace(joint, problem(tied, options, true, &found_s));
        joint.bundle.cameras = before.bundle.cameras;
        joint.bundle.sides = before.bundle.sides;
        // The same views make the same placements.
        joint.bundle.placements = before.bundle.placements;
        joint.passes = before.passes;
        joint.passes.push(("all cameras, at the offsets found", joint.bundle.solve(robust)?));
        known_s = found_s;
    }
    Ok(())
}

/// A board at an instant: its number, and when, by the rig's clock, the first and the last of its frames with times were taken.
struct Meeting {
    placement: usize,
    between_s: Option<[f64; 2]>,
}

impl Meeting {
    /// The time to which all corners are brought: as near as can be to all frames.
    fn time_s(&self) -> Option<f64> {
        self.between_s.map(|[first, last]| 0.5 * (first + last))
    }
}

/// The problem, with corners at the times that these offsets of the cameras say.
fn problem(tied: Tied<'_>, options: &BoardOptions, timed: bool, offsets_s: &[f64]) -> Joint {
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
        bundle.cameras.push(BundleCamera { name, intrinsics, pose: *pose, time_offset_s: offsets_s[index], free });
    }
    // In the frame of the front, if it is known where that is.
    let key = |view: &BoardView| {
        let face = if side.is_some() { Face::Front } else { plate.face(view) };
        (face, view.instant.clone())
    };
    // A board that cameras did not see at once is another one for each of them.
    let whose = |view: &BoardView, camera: usize| options.untied.contains(&view.instant).then_some(camera);
    let (mut moments, mut faces, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
    let mut meetings: BTreeMap<((Face, String), Option<usize>), Meeting> = BTreeMap::new();
    for (index, view) in seen.iter().enumerate().flat_map(|(index, seen)| seen.views.iter().map(move |v| (index, v))) {
        let key = key(view);
        let Some(board) = boards[index].get(&key) else { continue };
        let on_rig = view.time_s.map(|time_s| time_s + offsets_s[index]);
        let meeting = meetings.entry((key.clone(), whose(view, index))).or_insert_with(|| {
            bundle.placements.push(Placement::Board(board.then(&poses[index].inverse())));
            moments.push(view.moment());
            faces.push(key.0);
            Meeting { placement: bundle.placements.len() - 1, between_s: None }
        });
        if let Some(on_rig) = on_rig {
            let [first, last] = meeting.between_s.unwrap_or([on_rig; 2]);
            meeting.between_s = Some([first.min(on_rig), last.max(on_rig)]);
        }
    }
    for (index, seen) in seen.iter().enumerate() {
        let track = Track::of(&seen.views);
        let in_order = if has_times(&[seen]) { None } else { Some(Track::by_number(&seen.views)) };
        for view in &seen.views {
            let key = key(view);
            if !boards[index].contains_key(&key) {
                continue;
            }
            let Some(meeting) = meetings.get(&(key, whose(view, index))) else { continue };
            let speed = in_order.as_ref().unwrap_or(&track).speed_of(view);
            let offset_s = offsets_s[index];
            let at_s = meeting.time_s().filter(|_| view.time_s.is_some()).map(|on_rig| on_rig - offset_s);
            let back = plate.face(view) == Face::Back;
            for mut observation in observations(view, plate, index, meeting.placement, alone[index].sigma_px()) {
                observation.side = side.filter(|_| back).map(|_| 0);
                let corner = view.corners.iter().find(|corner| corner.pixel == observation.pixel);
                let passing = at_s.zip(corner).and_then(|(at_s, corner)| track.at(view, corner.id, at_s));
                if let Some(passing) = passing {
                    observation.pixel = passing.pixel;
                    observation.sigma_px = observation.sigma_px.hypot(passing.extra_px);
                    if timed {
                        observation.pixel += passing.velocity * offset_s;
                        observation.velocity = passing.velocity;
                    }
                }
                speeds.push(speed);
                bundle.observations.push(observation);
            }
        }
    }
    let sigma_px = alone.iter().map(|alone| alone.sigma_px()).collect();
    Joint { sigma_px, scatter_s: vec![0.0; seen.len()], bundle, moments, faces, speeds, passes: Vec::new(), timed }
}
