//! A body as far as it is known: how it moves, what it looks like, and by what that was found.

use std::collections::BTreeMap;

use erfgs_calibrate::statistics::median;
use erfgs_dataset::{Body, BodyPose, SurfacePoint};
use glam::DVec3;
use serde_json::{Value, json};

use super::{
    carve::{self, Carved, Place},
    centres::Track,
    contrast::{Change, mean_contrast},
    film::Film,
    grow::{Grower, Grown},
    near_events::{Subject, Windows},
    path::Path,
    refine::{self, Refined},
    shades::Shape,
    spin::{Spin, rounded, vector},
    turn::Turn,
};

/// Poses are at most so far apart, seconds, and turn by at most so much from one to the next, radians.
const POSE_STEP_S: f64 = 0.004;
const POSE_TURN: f64 = 0.5;
/// More poses of one body are of no use; they are farther apart then.
const MOST_POSES: f64 = 50_000.0;
/// For this share of the exposure a thing must be inside its silhouettes; near its ends it hardly leaves a trace.
pub const EXPOSED: f64 = 0.4;
/// So many places of a shape are held against events, at most.
const MOST_SURFACE: usize = 2400;
/// So much sharper events must be for a thing to be followed by its looks; if it was not found to turn, sharper at all.
const LOOKS_IF: f64 = 1.03;

/// How a thing moves, and its shape by that.
pub struct Motion {
    path: Path,
    turn: Turn,
    carved: Carved,
}

impl Motion {
    /// The shape as it is held against the events around an instant.
    fn subject(&self, film: &Film, thing: usize, moment: usize, step_s: f64) -> Subject<'_> {
        let t_s = film.moments[moment].t_s;
        let rotation = self.turn.at(t_s);
        let step = self.carved.points.len().div_ceil(MOST_SURFACE).max(1);
        let points = self.carved.points.iter().step_by(step);
        let turned =
            |point: &SurfacePoint| (rotation * DVec3::from(point.position_m), rotation * DVec3::from(point.normal));
        let (places, normals): (Vec<DVec3>, Vec<DVec3>) = points.map(turned).unzip();
        let rate = self.turn.rate(t_s);
        let around_us = refine::around_us(self.turn.fastest(), step_s);
        Subject { thing, moment, places, normals: Some(normals), path: &self.path, rate, around_us }
    }

    /// The motion that a second look at events tells, and its rates where they change. Rotations at the instants become others.
    fn refined(&self, film: &Film, refined: &Refined, upright_s: f64) -> Option<(Path, Turn)> {
        let time = |moment: usize| film.moments[moment].t_s;
        let rates = if refined.changing {
            let more = |&(moment, more): &(usize, DVec3)| (time(moment), self.turn.rate(time(moment)) + more);
            refined.rates.iter().map(more).collect()
        } else {
            let more = refined.rates.first()?.1;
            self.turn.rates().iter().map(|&(t_s, rate)| (t_s, rate + more)).collect()
        };
        let velocity = |&(moment, more): &(usize, DVec3)| (time(moment), self.path.velocity(time(moment)) + more);
        let velocities: Vec<(f64, DVec3)> = refined.velocities.iter().map(velocity).collect();
        Some((self.path.clone().with_velocities(&velocities), Turn::changing(upright_s, rates)))
    }
}

/// A body as far as it is known.
pub struct Draft<'a> {
    track: &'a Track,
    shapes: &'a [Shape],
    best: &'a Shape,
    motion: Motion,
    /// The motion that its looks tell.
    grown: Option<Motion>,
    found_by: BTreeMap<String, Value>,
}

impl<'a> Draft<'a> {
    /// With a shape of its own; none where none is left. `rates` are those that change, if they do.
    pub fn new(
        film: &Film,
        track: &'a Track,
        shapes: &'a [Shape],
        path: Path,
        spin: Spin,
        rates: Option<Vec<(f64, DVec3)>>,
    ) -> Option<Self> {
        let best = best_seen(film, track, shapes)?;
        let upright_s = film.moments[best.moment].t_s;
        let turn = match rates {
            Some(rates) => Turn::changing(upright_s, rates),
            None => Turn::steady(upright_s, spin.rate),
        };
        let carved = carved(film, track, shapes, best, &path, &turn)?;
        let motion = Motion { path, turn, carved };
        let mut draft = Self { track, shapes, best, motion, grown: None, found_by: spin.found_by };
        let grown = draft.grower(film, &draft.motion).grow();
        draft.grown = grown.map(|grown| draft.followed(film, &draft.motion, grown));
        Some(draft)
    }

    /// What is held against events around every instant: thing `number` by its motion, and `number` + 1 by its looks.
    pub fn subjects(&self, film: &Film, number: usize, step_s: f64) -> Vec<Subject<'_>> {
        let mut subjects = Vec::new();
        for (thing, motion) in std::iter::zip(number.., [Some(&self.motion), self.grown.as_ref()]) {
            let Some(motion) = motion else { continue };
            subjects.extend(self.shapes.iter().map(|shape| motion.subject(film, thing, shape.moment, step_s)));
        }
        subjects
    }

    fn grower<'b>(&'b self, film: &'b Film, motion: &'b Motion) -> Grower<'b> {
        let best = self.shapes.iter().position(|shape| shape.moment == self.best.moment).unwrap_or(0);
        let (cell_m, radius_m) = (cell_m(film, self.track), self.track.radius_m);
        Grower { film, shapes: self.shapes, path: &motion.path, turn: &motion.turn, best, radius_m, cell_m }
    }

    /// The motion through the poses that its looks tell.
    fn followed(&self, film: &Film, motion: &Motion, grown: Grown) -> Motion {
        let poses =
            || std::iter::zip(self.shapes, &grown.poses).map(|(shape, pose)| (film.moments[shape.moment].t_s, pose));
        let rotations: Vec<_> = poses().map(|(t_s, pose)| (t_s, pose.1)).collect();
        let places: Vec<_> = poses().map(|(t_s, pose)| (t_s, pose.0)).collect();
        Motion { turn: motion.turn.through(&rotations), path: motion.path.through(&places), carved: grown.carved }
    }

    /// Improves the motion by windows of its own shape: those by its motion, and those by its looks.
    pub fn look_again(&mut self, film: &Film, windows: &[Windows; 2]) {
        let looks = self.grown.take();
        match looks.filter(|_| self.looks_are_better(windows)) {
            Some(looks) => self.improve_looks(film, looks, &windows[1]),
            None => self.improve_motion(film, &windows[0]),
        }
    }

    /// Whether events, which took no part in following its looks, are sharper by them. Without events they are all that there is.
    fn looks_are_better(&mut self, [by_motion, by_looks]: &[Windows; 2]) -> bool {
        let sharp = |windows: &Windows| {
            let all: Vec<_> = windows.values().flatten().collect();
            mean_contrast(&all, Change::default())
        };
        let gained = sharp(by_looks) / sharp(by_motion).max(f64::MIN_POSITIVE);
        let least = if self.motion.turn.fastest() > 0.0 { LOOKS_IF } else { 1.0 };
        let better = by_motion.is_empty() || gained > least;
        if !by_motion.is_empty() {
            self.found_by.insert("contrast_gained_by_looks".into(), json!(rounded(gained, 4)));
        }
        self.found_by.insert("followed_by_looks".into(), json!(better));
        better
    }

    /// Where it is at the instants is known by its looks; events tell how it gets from one to the next.
    fn improve_looks(&mut self, film: &Film, looks: Motion, windows: &Windows) {
        if self.motion.turn.fastest() == 0.0 {
            self.found_by.insert("rotation".into(), json!("by its looks"));
        }
        self.motion = looks;
        let Some((path, turn)) = self.refined(film, windows) else { return };
        let time = |shape: &Shape| film.moments[shape.moment].t_s;
        let kept: Vec<_> = self.shapes.iter().map(time).map(|t_s| (t_s, self.motion.turn.at(t_s))).collect();
        (self.motion.path, self.motion.turn) = (path, turn.through(&kept));
        let again = self.grower(film, &self.motion).realign(self.motion.carved.clone());
        if let Some(grown) = again {
            self.found_by.insert("colours_apart".into(), json!(grown.apart.map(|apart| rounded(apart, 1))));
            self.motion = self.followed(film, &self.motion, grown);
        }
    }

    /// Takes what events tell more than its motion, if a shape can be carved by that.
    fn improve_motion(&mut self, film: &Film, windows: &Windows) {
        let Some((path, turn)) = self.refined(film, windows) else { return };
        if let Some(carved) = carved(film, self.track, self.shapes, self.best, &path, &turn) {
            self.motion = Motion { path, turn, carved };
        }
    }

    fn refined(&mut self, film: &Film, windows: &Windows) -> Option<(Path, Turn)> {
        let refined = refine::refine(windows);
        let next = self.motion.refined(film, &refined, film.moments[self.best.moment].t_s);
        self.found_by.extend(refined.found_by);
        next
    }

    /// The body.
    pub fn body(self, film: &Film, number: usize) -> Body {
        let usual = median(self.shapes.iter().map(|shape| shape.places.len() as f64)).unwrap_or(0.0);
        let upright_s = film.moments[self.best.moment].t_s;
        let facts = [
            ("instants", json!(self.shapes.len())),
            ("sure_instants", json!(self.track.sure.iter().filter(|sure| **sure).count())),
            ("hull_points", json!(usual)),
            ("radius_m", json!(rounded(self.track.radius_m, 4))),
            ("rate_rad_s", vector(self.motion.turn.rate(upright_s))),
            ("carving_agreement", json!(rounded(self.motion.carved.agree, 2))),
            ("carving_cell_m", json!(rounded(self.motion.carved.cell_m, 5))),
            ("best_seen_ns", json!(film.moments[self.best.moment].t_ns)),
        ];
        let mut found_by = self.found_by;
        if self.motion.turn.changes() {
            let rates =
                self.shapes.iter().map(|shape| &film.moments[shape.moment]).map(
                    |moment| json!({"t_ns": moment.t_ns, "rate_rad_s": vector(self.motion.turn.rate(moment.t_s))}),
                );
            found_by.insert("rates".into(), rates.collect());
        }
        found_by.extend(facts.map(|(name, value)| (name.to_owned(), value)));
        Body {
            name: format!("body{number}"),
            span_ns: span_ns(film, self.track),
            poses: poses(film, &self.motion.path, &self.motion.turn),
            points: self.motion.carved.points,
            found_by,
        }
    }
}

/// Carves a thing by how it turns.
fn carved(film: &Film, track: &Track, shapes: &[Shape], best: &Shape, path: &Path, turn: &Turn) -> Option<Carved> {
    let place = |shape: &Shape| {
        let moment = &film.moments[shape.moment];
        let open = [-0.5, 0.5].map(|side| moment.t_s + side * EXPOSED * moment.exposure_s);
        Place {
            moment: shape.moment,
            centre: shape.centre,
            rotation: turn.at(moment.t_s),
            exposed: open.map(|t_s| (path.at(t_s), turn.at(t_s))),
        }
    };
    let places: Vec<Place> = shapes.iter().map(place).collect();
    carve::carve(film, &best.places, &places, cell_m(film, track))
}

/// A cell of the hulls is two or three pixels wide: cells of about one, but of a thing no more than some thousand.
fn cell_m(film: &Film, track: &Track) -> f64 {
    (0.36 * film.cell_m).max(0.045 * track.radius_m)
}

/// The instant at which a thing is seen best: surely, with about as many points as usual, about the middle of its time.
fn best_seen<'a>(film: &Film, track: &Track, shapes: &'a [Shape]) -> Option<&'a Shape> {
    let usual = median(shapes.iter().map(|shape| shape.places.len() as f64))?.max(1.0);
    let middle = median(shapes.iter().map(|shape| film.moments[shape.moment].t_s))?;
    let any_sure = shapes.iter().any(|shape| track.sure[shape.moment]);
    let odd = |shape: &Shape| {
        (shape.places.len().max(1) as f64 / usual).ln().abs() + (film.moments[shape.moment].t_s - middle).abs()
    };
    shapes.iter().filter(|shape| track.sure[shape.moment] || !any_sure).min_by(|a, b| odd(a).total_cmp(&odd(b)))
}

/// When a track is in view: half an interval beyond its ends, or as long as the recording where it is followed from end to end.
fn span_ns(film: &Film, track: &Track) -> [i64; 2] {
    let [begin, end] = film.span_ns;
    let (first, last) = (track.instants().next(), track.instants().next_back());
    let time = |moment: usize| film.moments[moment].t_ns;
    let from = match first {
        Some(first) if first > 0 => time(first) - (time(first) - time(first - 1)) / 2,
        _ => begin,
    };
    let to = match last {
        Some(last) if last + 1 < film.moments.len() => time(last) + (time(last + 1) - time(last)) / 2,
        _ => end,
    };
    [from.max(begin), to.min(end)]
}

/// The poses of a body over the whole recording.
fn poses(film: &Film, path: &Path, turn: &Turn) -> Vec<BodyPose> {
    let seconds = film.seconds();
    let step = POSE_STEP_S.min(POSE_TURN / turn.fastest().max(1e-9)).max(seconds / MOST_POSES);
    let count = (seconds / step).ceil().max(1.0) as usize;
    let pose = |index: usize| {
        let t_s = seconds * index as f64 / count as f64;
        let rotation = turn.at(t_s);
        BodyPose {
            t_ns: film.ns(t_s),
            translation_m: path.at(t_s).to_array(),
            rotation_wxyz: [rotation.w, rotation.x, rotation.y, rotation.z],
        }
    };
    (0..=count).map(pose).collect()
}
