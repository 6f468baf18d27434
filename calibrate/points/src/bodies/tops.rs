//! Free tops: what falls and is not round turns about an axis of its own at one rate, while that axis turns about the angular momentum
//! at another.
//!
//! Both rates are constant where two moments of inertia are equal, and nearly so for a while where they are not, so that six numbers
//! determine all rotations. A candidate is judged by the shape that silhouettes of all instants leave if the thing turns so (`looks`),
//! and by how sharp events are by its rates: the shape hardly tells how fast what is nearly symmetric turns about its own axis. The
//! candidates that agree best for the few instants around the best one are improved with more and more of them.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::{
    contrast::{Change, Window, mean_contrast},
    descend::Steps,
    grow::Grower,
    near_events::Windows,
    path::Path,
    refine::best_velocity,
    turn::{Turn, directions, rates},
};

/// Rates that are tried with the fewest instants: directions, and radians per second.
const DIRECTIONS: usize = 60;
const RATES: [f64; 6] = [2.5, 5.0, 8.0, 11.5, 15.0, 20.0];
/// Parts of a rate that are about the thing's own axis, which are tried once there are more instants: likewise.
const OWN_DIRECTIONS: usize = 16;
const OWN_RATES: [f64; 2] = [4.0, 9.0];
/// So many instants before and after the best at first, and how many times more each time, one at least.
const FIRST_REACH: usize = 1;
const REACHES_MORE: f64 = 1.35;
/// So many candidates are kept each time; one in the end. They differ by so much at least, radians per second.
const KEPT: [usize; 4] = [16, 8, 4, 3];
const ALIKE: f64 = 1.0;
/// First steps by which numbers are improved: of rates, radians per second, and of the path, radii.
const RATE_STEP: f64 = 1.6;
const PLACE_STEP: f64 = 0.1;
const STEPS: Steps = Steps { halvings: 3, most: 4 };
/// What it is worth that events are twice as sharp as without a turn, beside what the shape says.
const SHARP_IS_WORTH: f64 = 130.0;
/// Numbers of a top: a steady rate; both rates and its place, without which a path that is off by centimetres leads to wrong rates; and its
/// velocity, too, which few instants do not tell.
const STEADY: usize = 3;
const RATES_AND_PLACE: usize = 9;
const ALL: usize = 12;
/// Rotations are told by rates so far apart in time, seconds.
const APART_S: f64 = 0.005;

/// How a free top turns, and how its path differs from the one that is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Top {
    /// About the angular momentum, radians per second about axes of the world.
    pub about: DVec3,
    /// About its own axis, radians per second about axes of the world when it is upright.
    pub own: DVec3,
    /// How far its path is moved when it is upright, metres, and by which velocity, metres per second.
    pub moved: [DVec3; 2],
}

impl Top {
    /// When it is upright, and within a time, seconds.
    pub fn turn(&self, upright_s: f64, [first_s, last_s]: [f64; 2]) -> Turn {
        if self.own == DVec3::ZERO {
            return Turn::steady(upright_s, self.about);
        }
        let rate = |t_s: f64| self.about + DQuat::from_scaled_axis(self.about * (t_s - upright_s)) * self.own;
        let steps = ((last_s - first_s) / APART_S).ceil().clamp(1.0, 1e4) as usize;
        let at = |step: usize| first_s + (last_s - first_s) * step as f64 / steps as f64;
        Turn::changing(upright_s, (0..=steps).map(at).map(|t_s| (t_s, rate(t_s))).collect())
    }

    /// With one of its numbers changed: a rate, a place or a velocity.
    fn changed(&self, number: usize, [rate, place, velocity]: [f64; 3]) -> Self {
        let mut changed = *self;
        match (number / 3, number % 3) {
            (0, axis) => changed.about[axis] += rate,
            (1, axis) => changed.own[axis] += rate,
            (2, axis) => changed.moved[0][axis] += place,
            (_, axis) => changed.moved[1][axis] += velocity,
        }
        changed
    }

    /// Tops that have its rate when upright, of which parts are about axes of their own.
    fn with_own_axes(&self) -> impl Iterator<Item = Self> {
        let own = directions(OWN_DIRECTIONS).into_iter().flat_map(|along| OWN_RATES.map(|rate| rate * along));
        let of = *self;
        std::iter::once(DVec3::ZERO).chain(own).map(move |own| Self { about: of.about - own, own, ..of })
    }

    fn apart(&self, other: &Self) -> f64 {
        self.about.distance(other.about).max(self.own.distance(other.own))
    }
}

/// A top, and how badly it agrees with what is seen.
type Judged = (Top, f64);

/// The events around an instant.
struct Around<'a> {
    /// Which of the thing's shapes is of that instant.
    shape: usize,
    t_s: f64,
    windows: &'a [Window],
    /// How sharp they are without a turn.
    usual: f64,
}

impl Around<'_> {
    fn sharp(&self, change: Change) -> f64 {
        mean_contrast(self.windows, change) / self.usual
    }
}

/// Looks for the top that a thing is.
pub struct Search<'a> {
    /// The thing with its path; its turn is not used.
    grower: Grower<'a>,
    events: Vec<Around<'a>>,
    /// When its axes are those of the world, seconds.
    upright_s: f64,
    /// The time for which it is seen, seconds.
    span_s: [f64; 2],
}

impl<'a> Search<'a> {
    /// For a thing with its path, events around its instants, and when its axes are those of the world, seconds.
    pub fn new(grower: Grower<'a>, windows: &'a Windows, upright_s: f64) -> Self {
        let time = |moment: usize| grower.film.moments[moment].t_s;
        let around = |(shape, moment): (usize, usize)| {
            let windows = windows.get(&moment)?;
            let usual = mean_contrast(windows, Change::default());
            (usual > 0.0).then_some(Around { shape, t_s: time(moment), windows, usual })
        };
        let mut moments = grower.shapes.iter().map(|shape| shape.moment);
        let events = moments.clone().enumerate().filter_map(around).collect();
        let first = moments.clone().next().map_or(upright_s, time);
        let last = moments.next_back().map_or(upright_s, time);
        Self { grower, events, upright_s, span_s: [first, last] }
    }

    /// How a top turns while the thing is seen, and how its path is then.
    pub fn motion(&self, top: &Top) -> (Path, Turn) {
        (self.grower.path.moved(top.moved, self.upright_s), top.turn(self.upright_s, self.span_s))
    }

    /// How badly a motion agrees with what is seen at all instants.
    pub fn disagreement(&self, path: &Path, turn: &Turn) -> f64 {
        let velocities = self.velocities(turn);
        self.of_motion(path, turn, &self.grower.around(self.grower.shapes.len()), &velocities)
    }

    /// The top that agrees best with what is seen at all instants.
    pub fn best(&self) -> Judged {
        let steady = rates(DIRECTIONS, &RATES).into_iter().map(|about| Top { about, ..Top::default() });
        let mut known = self.grower.around(FIRST_REACH);
        let mut tops = self.better(steady.collect(), &known, KEPT[0], STEADY);
        let mut reach = FIRST_REACH;
        for stage in 1.. {
            reach = ((reach as f64 * REACHES_MORE) as usize).max(reach + 1);
            let more = self.grower.around(reach);
            if more == known {
                break;
            }
            known = more;
            let next: Vec<Top> = match stage {
                1 => tops.iter().flat_map(|judged| judged.0.with_own_axes()).collect(),
                _ => tops.into_iter().map(|judged| judged.0).collect(),
            };
            tops = self.better(next, &known, KEPT.get(stage).copied().unwrap_or(1), RATES_AND_PLACE);
        }
        self.improved(tops.first().map_or(Top::default(), |judged| judged.0), &known, ALL)
    }

    /// So many of the best tops, each improved by its first `numbers`.
    fn better(&self, tops: Vec<Top>, known: &[usize], kept: usize, numbers: usize) -> Vec<Judged> {
        let none = vec![DVec3::ZERO; self.events.len()];
        let judged = tops.into_par_iter().map(|top| (top, self.judged(&top, known, &none))).collect();
        let improved = best_of(judged, kept).into_par_iter().map(|judged| self.improved(judged.0, known, numbers));
        best_of(improved.collect(), kept)
    }

    /// Velocities more than those of the path with which events are sharpest if the thing turns so, metres per second: the path is
    /// right to some decimetres per second, and events are blurred by that, too.
    fn velocities(&self, turn: &Turn) -> Vec<DVec3> {
        let best = |around: &Around<'_>| {
            let start = Change { rate: turn.rate(around.t_s), velocity: DVec3::ZERO };
            best_velocity(around.windows, around.usual, start)
        };
        self.events.par_iter().map(best).collect()
    }

    fn judged(&self, top: &Top, known: &[usize], velocities: &[DVec3]) -> f64 {
        let (path, turn) = self.motion(top);
        self.of_motion(&path, &turn, known, velocities)
    }

    fn of_motion(&self, path: &Path, turn: &Turn, known: &[usize], velocities: &[DVec3]) -> f64 {
        let (mut sharp, mut count) = (0.0, 0.0);
        for (around, &velocity) in std::iter::zip(&self.events, velocities) {
            if known.contains(&around.shape) {
                sharp += around.sharp(Change { rate: turn.rate(around.t_s), velocity }) - 1.0;
                count += 1.0;
            }
        }
        let worth = SHARP_IS_WORTH * sharp / f64::max(count, 1.0);
        Grower { turn, path, ..self.grower }.disagreement(known) - worth
    }

    /// The top near one that agrees best, by changes of its first `numbers`.
    fn improved(&self, top: Top, known: &[usize], numbers: usize) -> Judged {
        let velocities = self.velocities(&self.motion(&top).1);
        let half_s = 0.5 * (self.span_s[1] - self.span_s[0]).max(1e-9);
        let place = PLACE_STEP * self.grower.radius_m;
        let first = [RATE_STEP, place, place / half_s];
        let changed = |top: &Top, number: usize, step: f64| top.changed(number, first.map(|first| step * first));
        STEPS.descend(top, numbers, changed, |top| self.judged(top, known, &velocities))
    }
}

/// So many of the best that differ.
fn best_of(mut tops: Vec<Judged>, kept: usize) -> Vec<Judged> {
    tops.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut best: Vec<Judged> = Vec::with_capacity(kept);
    for top in tops {
        if best.len() < kept && best.iter().all(|other| other.0.apart(&top.0) > ALIKE) {
            best.push(top);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{
        carve::{Place, tests::ellipsoid},
        path::Path,
        shades::Shape,
    };

    const HALF: DVec3 = DVec3::new(0.22, 0.12, 0.06);

    #[test]
    fn a_top_that_tumbles_is_found_though_its_path_is_a_little_wrong() {
        let upright_s = 0.2;
        let truth = Top { about: DVec3::new(5.0, 7.0, -2.0), own: DVec3::new(3.0, -2.5, 2.0), moved: [DVec3::ZERO; 2] };
        let times: Vec<f64> = (0..7).map(|at| f64::from(at) / 15.0).collect();
        let span_s = [times[0], times[6]];
        let turn = truth.turn(upright_s, span_s);
        let upright = DQuat::from_scaled_axis(DVec3::new(0.4, -0.8, 0.3));
        let pose = |&t_s: &f64| {
            let after = t_s - upright_s;
            (t_s, DVec3::new(1.2 * after, 4.9 * after * after - 0.1, 0.2 * after), turn.at(t_s) * upright)
        };
        let poses: Vec<_> = times.iter().map(pose).collect();
        let place = |(moment, &(_, centre, rotation)): (usize, &(f64, DVec3, DQuat))| Place {
            moment,
            centre,
            rotation,
            exposed: [(centre, rotation); 2],
        };
        let places: Vec<Place> = poses.iter().enumerate().map(place).collect();
        // A colour in each octant.
        let mut film = ellipsoid(HALF, &places, |at| at.to_array().map(|at| if at > 0.0 { 220 } else { 60 }));
        film.cell_m = 0.045;
        for (moment, &t_s) in std::iter::zip(&mut film.moments, &times) {
            moment.t_s = t_s;
        }
        let hull = |(moment, &(_, centre, rotation)): (usize, &(f64, DVec3, DQuat))| {
            let points = directions(500).into_iter().map(|along| centre + rotation * (1.15 * HALF * along));
            Shape::new(moment, centre, points.map(|place| (place, [128; 3])))
        };
        let shapes: Vec<Shape> = poses.iter().enumerate().map(hull).collect();
        let wrong = DVec3::new(0.02, 0.0, -0.02);
        let path = Path::new(times.clone(), poses.iter().map(|pose| pose.1 + wrong).collect());
        let still = Turn::steady(upright_s, DVec3::ZERO);
        let grower =
            Grower { film: &film, shapes: &shapes, path: &path, turn: &still, best: 3, radius_m: 0.2, ball: None };
        let windows = Windows::new();
        let search = Search::new(grower, &windows, upright_s);
        let (top, disagreement) = search.best();
        assert_eq!(grower.around(shapes.len()), (0..7).collect::<Vec<_>>());
        assert!(disagreement < 0.7 * search.disagreement(&path, &still), "{disagreement}");
        assert!(disagreement < 1.05 * search.disagreement(&path, &turn), "{disagreement}");
        let found = top.turn(upright_s, span_s);
        for &t_s in &times {
            let off = found.at(t_s).angle_between(turn.at(t_s));
            assert!(off < 0.2, "{off} rad at {t_s} s: {top:?}");
        }
    }

    #[test]
    fn a_top_turns_about_two_axes_at_steady_rates() {
        let top = Top { about: DVec3::Y * 5.0, own: DVec3::X * 8.0, moved: [DVec3::ZERO; 2] };
        let turn = top.turn(0.1, [0.0, 1.0]);
        for t_s in [0.0, 0.1, 0.37, 0.9] {
            let after = t_s - 0.1;
            let expected = DQuat::from_rotation_y(5.0 * after) * DQuat::from_rotation_x(8.0 * after);
            assert!(turn.at(t_s).angle_between(expected) < 2e-3, "{t_s} s");
        }
        assert_eq!(Top { own: DVec3::ZERO, ..top }.turn(0.1, [0.0, 1.0]), Turn::steady(0.1, DVec3::Y * 5.0));
    }
}
