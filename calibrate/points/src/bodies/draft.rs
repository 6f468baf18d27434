//! A body as far as it is known: how it moves, what it looks like, and by what that was found.

use std::collections::BTreeMap;

use erfgs_calibrate::statistics::median;
use erfgs_dataset::{Body, BodyPose, SurfacePoint};
use glam::DVec3;
use serde_json::{Value, json};

use super::{
    carve::Carved,
    centres::Track,
    contrast::{Change, mean_contrast},
    film::Film,
    grow::{Grower, Grown},
    near_events::{Subject, Windows},
    path::Path,
    refine::{self, Refined},
    shades::Shape,
    spin::{Spin, rounded, vector},
    stretches::Stretch,
    things::Thing,
    tops::Search,
    turn::Turn,
};

/// Poses are at most so far apart, seconds, and turn by at most so much from one to the next, radians.
const POSE_STEP_S: f64 = 0.004;
const POSE_TURN: f64 = 0.5;
/// More poses of one body are of no use; they are farther apart then.
const MOST_POSES: f64 = 50_000.0;
/// So many places of a shape are held against events, at most.
const MOST_SURFACE: usize = 2400;
/// What falls turns as a free top if it disagrees with what is seen by so much less then.
const TOP_IF: f64 = 3.0;
/// A thing is followed by its looks if events are so sharp by them at least, compared with how sharp they are by its motion alone: these
/// know its rates, but not how they add up, and of a thing that is not round its silhouettes know that better.
const LOOKS_IF: f64 = 0.975;

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

    /// The motion that a second look at the events of each of its stretches tells. Rotations at the instants become others.
    fn refined(&self, film: &Film, looks: &[(Stretch, Refined)], upright_s: f64) -> Option<(Path, Turn)> {
        looks.iter().find(|(_, refined)| !refined.rates.is_empty())?;
        let time = |moment: usize| film.moments[moment].t_s;
        let rates = looks.iter().flat_map(|(stretch, refined)| -> Vec<(f64, DVec3)> {
            if refined.changing {
                let more = |&(moment, more): &(usize, DVec3)| (time(moment), self.turn.rate(time(moment)) + more);
                return refined.rates.iter().map(more).collect();
            }
            let more = refined.rates.first().map_or(DVec3::ZERO, |first| first.1);
            let own = self.turn.rates().iter().filter(|rate| stretch.has(rate.0));
            own.map(|&(t_s, rate)| (t_s, rate + more)).collect()
        });
        let velocity = |&(moment, more): &(usize, DVec3)| (time(moment), self.path.velocity(time(moment)) + more);
        let velocities: Vec<(f64, DVec3)> =
            looks.iter().flat_map(|(_, refined)| &refined.velocities).map(velocity).collect();
        Some((self.path.clone().with_velocities(&velocities), Turn::changing(upright_s, rates.collect())))
    }
}

/// Path and turn of a thing as a free top, if that agrees better with what is seen than the motion that is assumed.
fn top(
    assumed: Grower<'_>,
    windows: &Windows,
    upright_s: f64,
    found_by: &mut BTreeMap<String, Value>,
) -> Option<(Path, Turn)> {
    let search = Search::new(assumed, windows, upright_s);
    let (top, after) = search.best();
    let before = search.disagreement(assumed.path, assumed.turn);
    found_by.insert("disagreement".into(), json!([before, after].map(|of| rounded(of, 1))));
    (after < before - TOP_IF).then(|| {
        found_by.insert("rotation".into(), json!("as a free top, by its shape and events"));
        search.motion(&top)
    })
}

/// A body as far as it is known.
pub struct Draft<'a> {
    thing: &'a Thing,
    /// Which of its shapes is seen best.
    best: usize,
    motion: Motion,
    /// The motion that its looks tell.
    grown: Option<Motion>,
    found_by: BTreeMap<String, Value>,
}

impl<'a> Draft<'a> {
    /// With a shape of its own; none where none is left. `rates` are those that change, if they do, `windows` the events around its
    /// instants.
    pub fn new(
        film: &Film,
        thing: &'a Thing,
        windows: &Windows,
        mut spin: Spin,
        rates: Option<Vec<(f64, DVec3)>>,
    ) -> Option<Self> {
        let Thing { track, shapes, path, .. } = thing;
        let best = best_seen(film, thing)?;
        let upright_s = film.moments[shapes[best].moment].t_s;
        let turn = match rates {
            Some(rates) => Turn::changing(upright_s, rates),
            None => Turn::steady(upright_s, spin.rate),
        };
        let ball = thing.ball.as_ref();
        let assumed = Grower { film, shapes, path, turn: &turn, best, radius_m: track.radius_m, ball };
        let top = if thing.falls && thing.ball.is_none() && thing.rate.is_none() {
            top(assumed, windows, upright_s, &mut spin.found_by)
        } else {
            None
        };
        let (path, turn) = top.unwrap_or_else(|| (path.clone(), turn.clone()));
        let grower = Grower { path: &path, turn: &turn, ..assumed };
        // A ball that flies is where its discs are, and its colours took part in how it turns.
        let (carved, grown) = (grower.carved()?, if thing.flies() { None } else { grower.grow() });
        let grown = grown.map(|grown| followed(film, shapes, &path, &turn, grown));
        let motion = Motion { path, turn, carved };
        Some(Self { thing, best, motion, grown, found_by: spin.found_by })
    }

    /// What is held against events around every instant: thing `number` by its motion, and `number` + 1 by its looks.
    pub fn subjects(&self, film: &Film, number: usize, step_s: f64) -> Vec<Subject<'_>> {
        let mut subjects = Vec::new();
        if self.thing.flies() {
            return subjects;
        }
        for (thing, motion) in std::iter::zip(number.., [Some(&self.motion), self.grown.as_ref()]) {
            let Some(motion) = motion else { continue };
            subjects.extend(self.thing.shapes.iter().map(|shape| motion.subject(film, thing, shape.moment, step_s)));
        }
        subjects
    }

    fn grower<'b>(&'b self, film: &'b Film, path: &'b Path, turn: &'b Turn) -> Grower<'b> {
        let Thing { shapes, track, ball, .. } = self.thing;
        Grower { film, shapes, path, turn, best: self.best, radius_m: track.radius_m, ball: ball.as_ref() }
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
        let better = by_motion.is_empty() || gained > LOOKS_IF;
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
        let kept: Vec<_> = self.thing.shapes.iter().map(time).map(|t_s| (t_s, self.motion.turn.at(t_s))).collect();
        let turn = turn.through(&kept);
        let again = self.grower(film, &path, &turn).realign(self.motion.carved.clone());
        self.motion = match again {
            Some(grown) => {
                self.found_by.insert("colours_apart".into(), json!(grown.apart.map(|apart| rounded(apart, 1))));
                followed(film, &self.thing.shapes, &path, &turn, grown)
            }
            None => Motion { path, turn, carved: self.motion.carved.clone() },
        };
    }

    /// Takes what events tell more than its motion, if a shape can be carved by that.
    fn improve_motion(&mut self, film: &Film, windows: &Windows) {
        let Some((path, turn)) = self.refined(film, windows) else { return };
        if let Some(carved) = self.grower(film, &path, &turn).carved() {
            self.motion = Motion { path, turn, carved };
        }
    }

    fn refined(&mut self, film: &Film, windows: &Windows) -> Option<(Path, Turn)> {
        let best_s = film.moments[self.thing.shapes[self.best].moment].t_s;
        let stretches = Stretch::all(self.motion.path.bounces_s());
        let look = |stretch: Stretch| (stretch, refine::refine(stretch.windows(film, windows)));
        let looks: Vec<(Stretch, Refined)> = stretches.into_iter().map(look).collect();
        let next = self.motion.refined(film, &looks, best_s);
        let best = looks.into_iter().find(|(stretch, _)| stretch.has(best_s));
        self.found_by.extend(best.map(|(_, refined)| refined.found_by).unwrap_or_default());
        next
    }

    /// The body.
    pub fn body(self, film: &Film) -> Body {
        let usual = median(self.thing.shapes.iter().map(|shape| shape.places.len() as f64)).unwrap_or(0.0);
        let best = &film.moments[self.thing.shapes[self.best].moment];
        let facts = [
            ("instants", json!(self.thing.shapes.len())),
            ("sure_instants", json!(self.thing.track.sure.iter().filter(|sure| **sure).count())),
            ("hull_points", json!(usual)),
            ("radius_m", json!(rounded(self.thing.track.radius_m, 4))),
            ("rate_rad_s", vector(self.motion.turn.rate(best.t_s))),
            ("carving_agreement", json!(rounded(self.motion.carved.agree, 2))),
            ("carving_cell_m", json!(rounded(self.motion.carved.cell_m, 5))),
            ("best_seen_ns", json!(best.t_ns)),
        ];
        let mut found_by = self.found_by;
        found_by.extend(self.thing.ball.as_ref().map(|ball| ("discs_off".into(), json!(rounded(ball.off, 3)))));
        if self.thing.flies() {
            // Its rates are right to some tenths of a radian per second, which add up.
            found_by.insert("followed_by_looks".into(), json!(false));
        }
        let bounces: Vec<i64> = self.motion.path.bounces_s().map(|t_s| film.ns(t_s)).collect();
        if !bounces.is_empty() {
            found_by.insert("bounces_ns".into(), json!(bounces));
        }
        if self.motion.turn.changes() {
            let rates =
                self.thing.shapes.iter().map(|shape| &film.moments[shape.moment]).map(
                    |moment| json!({"t_ns": moment.t_ns, "rate_rad_s": vector(self.motion.turn.rate(moment.t_s))}),
                );
            found_by.insert("rates".into(), rates.collect());
        }
        found_by.extend(facts.map(|(name, value)| (name.to_owned(), value)));
        Body {
            name: self.thing.name.clone(),
            span_ns: span_ns(film, &self.thing.track),
            poses: poses(film, &self.motion.path, &self.motion.turn),
            points: self.motion.carved.points,
            found_by,
        }
    }
}

/// A motion led through the poses that its looks tell.
fn followed(film: &Film, shapes: &[Shape], path: &Path, turn: &Turn, grown: Grown) -> Motion {
    let poses = || std::iter::zip(shapes, &grown.poses).map(|(shape, pose)| (film.moments[shape.moment].t_s, pose));
    let rotations: Vec<_> = poses().map(|(t_s, pose)| (t_s, pose.1)).collect();
    let places: Vec<_> = poses().map(|(t_s, pose)| (t_s, pose.0)).collect();
    Motion { turn: turn.through(&rotations), path: path.through(&places), carved: grown.carved }
}

/// Which of a thing's shapes is seen best: surely, with about as many points as usual, about the middle of its time.
fn best_seen(film: &Film, Thing { track, shapes, .. }: &Thing) -> Option<usize> {
    let usual = median(shapes.iter().map(|shape| shape.places.len() as f64))?.max(1.0);
    let middle = median(shapes.iter().map(|shape| film.moments[shape.moment].t_s))?;
    let any_sure = shapes.iter().any(|shape| track.sure[shape.moment]);
    let odd = |shape: &Shape| {
        (shape.places.len().max(1) as f64 / usual).ln().abs() + (film.moments[shape.moment].t_s - middle).abs()
    };
    let sure = (0..shapes.len()).filter(|&at| track.sure[shapes[at].moment] || !any_sure);
    sure.min_by(|&a, &b| odd(&shapes[a]).total_cmp(&odd(&shapes[b])))
}

/// When a thing is seen best, seconds.
pub fn best_seen_s(film: &Film, thing: &Thing) -> Option<f64> {
    best_seen(film, thing).map(|best| film.moments[thing.shapes[best].moment].t_s)
}

/// When a track is in view: half an interval beyond its ends, or as long as the recording where things move from its beginning and to its
/// end. What began to move later, or came to rest, does not move before and after.
fn span_ns(film: &Film, track: &Track) -> [i64; 2] {
    let [begin, end] = film.span_ns;
    let time = |moment: usize| film.moments[moment].t_ns;
    let usual = (1e9 * film.step_s()) as i64;
    // Half of the interval to the next instant, or, where nothing moves beyond, to the end or half of the usual one.
    let half = |next: Option<i64>, to_end: i64| match next {
        Some(interval) => interval / 2,
        None if to_end > usual => usual / 2,
        None => to_end,
    };
    let [first, last] = [track.instants().next(), track.instants().next_back()];
    let from = first.map_or(begin, |first| {
        let before = first.checked_sub(1).map(|before| time(first) - time(before));
        time(first) - half(before, time(first) - begin)
    });
    let to = last.map_or(end, |last| {
        let after = (last + 1 < film.moments.len()).then(|| time(last + 1) - time(last));
        time(last) + half(after, end - time(last))
    });
    [from.max(begin), to.min(end)]
}

/// The poses of a body over the whole recording.
fn poses(film: &Film, path: &Path, turn: &Turn) -> Vec<BodyPose> {
    let seconds = film.seconds();
    let step = POSE_STEP_S.min(POSE_TURN / turn.fastest_led().max(1e-9)).max(seconds / MOST_POSES);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{detections::Histogram, film::Moment};

    /// The span, milliseconds, of what is followed at instants `seen` of a recording of a second in which things move at instants
    /// 100 ms apart.
    fn span_ms(moving_ms: std::ops::RangeInclusive<i64>, seen: std::ops::Range<usize>) -> [i64; 2] {
        let moment = |ms: i64| Moment {
            t_ns: 1_000_000 * ms,
            t_s: 1e-3 * ms as f64,
            exposure_s: 0.0,
            points: Vec::new(),
            colours: Vec::new(),
            views: Vec::new(),
        };
        let moments: Vec<Moment> = moving_ms.step_by(100).map(moment).collect();
        let centres: Vec<Option<DVec3>> =
            (0..moments.len()).map(|at| seen.contains(&at).then_some(DVec3::ZERO)).collect();
        let sure = vec![true; centres.len()];
        let film = Film { span_ns: [0, 1_000_000_000], eyes: Vec::new(), moments, cell_m: 0.02 };
        let colours = Histogram::of(&[]);
        let track = Track { centres, sure, met: Vec::new(), radius_m: 0.1, fall: None, colours, usual_points: 9.0 };
        span_ns(&film, &track).map(|t_ns| t_ns / 1_000_000)
    }

    #[test]
    fn a_body_is_in_view_half_an_interval_beyond_its_instants() {
        assert_eq!(span_ms(0..=1000, 0..11), [0, 1000]);
        assert_eq!(span_ms(0..=1000, 3..6), [250, 550]);
        // Frames need not be taken at the very beginning and end.
        assert_eq!(span_ms(60..=960, 0..10), [0, 1000]);
        // What flies out of a pot after 300 ms was not there before, and what comes to rest after 700 ms rests.
        assert_eq!(span_ms(300..=700, 0..5), [250, 750]);
        assert_eq!(span_ms(300..=700, 1..4), [350, 650]);
    }
}
