//! A thing followed by its own looks: from the instant at which it is seen best to the others, one by one.
//!
//! What is carved of it so far is laid onto the frames of the next instant, near where its motion takes it, so that its colours and
//! silhouettes fit; with that instant it is carved again. Rates that are a little wrong do not add up so.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use erfgs_dataset::SurfacePoint;

use super::{
    carve::{self, Carved, Place},
    descend::Steps,
    film::{Film, MOST_APART},
    path::{Path, fitted},
    round::Ball,
    shades::Shape,
    turn::{Turn, rates},
};

/// For this share of the exposure a thing must be inside its silhouettes; near its ends it hardly leaves a trace.
const EXPOSED: f64 = 0.4;
/// Points of a shape that are laid onto frames, at most.
const MOST_POINTS: usize = 400;
/// The first steps: of turns, radians, and of places, radii of the thing.
const TURN_STEP: f64 = 0.2;
const PLACE_STEP: f64 = 0.1;
const STEPS: Steps = Steps { halvings: 4, most: 8 };
/// What being away by a step from where its motion takes a thing costs.
const AWAY_COSTS: f64 = 5.0;
/// It is carved again with so many times more instants than the last time, so that long takes are not carved for each.
const CARVE_AGAIN: f64 = 1.1;
/// Turns far from where its motion takes it that are tried: directions, and radians; the best few are improved, and what they cost.
const FAR_DIRECTIONS: usize = 20;
const FAR_TURNS: [f64; 3] = [0.35, 0.7, 1.05];
const FAR_KEPT: usize = 3;
const FAR_COSTS: f64 = 16.0;

/// What a thing's poses say more than its motion is smoothed over so many instants before and after.
const SMOOTH: usize = 2;

/// A pose of a thing: where the origin of its frame is, and from its frame to the world.
pub type Pose = (DVec3, DQuat);

/// A thing, with its motion as it is known.
#[derive(Clone, Copy)]
pub struct Grower<'a> {
    /// The frames.
    pub film: &'a Film,
    /// Its points at each instant at which it is seen.
    pub shapes: &'a [Shape],
    /// Where it is.
    pub path: &'a Path,
    /// How it turns.
    pub turn: &'a Turn,
    /// Which of the shapes is seen best.
    pub best: usize,
    /// How large it is, metres.
    pub radius_m: f64,
    /// What it is as a ball, if it is round.
    pub ball: Option<&'a Ball>,
}

/// How a thing moves by its looks.
pub struct Grown {
    /// Its pose at each of its shapes.
    pub poses: Vec<Pose>,
    /// Its shape.
    pub carved: Carved,
    /// How far colours are apart from frames, in the mean, where its motion took it, and where its looks do.
    pub apart: [f64; 2],
}

impl Grower<'_> {
    /// Its shape by its motion alone; none where nothing of it is left.
    pub fn carved(&self) -> Option<Carved> {
        self.carve(&self.all_assumed(), &self.all())
    }

    /// Follows it from its best instant; none where nothing of it is left.
    pub fn grow(&self) -> Option<Grown> {
        let mut poses = self.all_assumed();
        let mut known = vec![self.best];
        let mut carved = self.carve(&poses, &known)?;
        let mut carved_by = known.len();
        for reach in 1..self.shapes.len() {
            for forward in [false, true] {
                let back = |at: usize| if forward { at.checked_sub(1) } else { Some(at + 1) };
                let at = if forward { Some(self.best + reach) } else { self.best.checked_sub(reach) };
                let Some(at) = at.filter(|&at| at < self.shapes.len()) else { continue };
                let Some(from) = back(at) else { continue };
                let mut starts = vec![(self.carried(poses[from], from, at), 0.0)];
                // As it went on from the instant before.
                let earlier = back(from).filter(|_| from != self.best);
                starts.extend(earlier.map(|earlier| (self.as_before(&poses, [earlier, from, at]), 0.0)));
                starts.extend(self.far(&carved.points, at, starts[0].0));
                let tried = starts.par_iter().map(|&(start, price)| {
                    let (pose, apart) = self.aligned(&carved.points, at, start);
                    (pose, apart + price)
                });
                let tried: Vec<(Pose, f64)> = tried.collect();
                poses[at] = tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))?.0;
                known.push(at);
            }
            if known.len() as f64 >= CARVE_AGAIN * carved_by as f64 {
                known.sort_unstable();
                carved = self.carve(&poses, &known)?;
                carved_by = known.len();
            }
        }
        self.settle(poses, carved)
    }

    /// Lays a shape onto all instants from where it is assumed to be, and carves it again.
    pub fn realign(&self, carved: Carved) -> Option<Grown> {
        self.settle(self.all_assumed(), carved)
    }

    fn settle(&self, mut poses: Vec<Pose>, mut carved: Carved) -> Option<Grown> {
        let all = self.all();
        let mut apart = [0.0; 2];
        for _ in 0..2 {
            let starts = self.smoothed(&poses);
            let aligned = all.par_iter().map(|&at| {
                let before = self.apart(&carved.points, at, self.assumed(at));
                let (pose, after) = self.aligned(&carved.points, at, starts[at]);
                (pose, [before, after])
            });
            let aligned: Vec<(Pose, [f64; 2])> = aligned.collect();
            apart = [0, 1].map(|when| aligned.iter().map(|both| both.1[when]).sum::<f64>() / all.len().max(1) as f64);
            poses = aligned.into_iter().map(|aligned| aligned.0).collect();
            carved = self.carve(&poses, &all)?;
        }
        Some(Grown { poses, carved, apart })
    }

    /// Poses that differ from the motion's more evenly: what one instant says alone is mostly noise.
    fn smoothed(&self, poses: &[Pose]) -> Vec<Pose> {
        let mut turns: Vec<DVec3> = Vec::with_capacity(poses.len());
        for (at, pose) in poses.iter().enumerate() {
            let more = (pose.1 * self.assumed(at).1.conjugate()).normalize();
            let more = if more.w < 0.0 { -more } else { more }.to_scaled_axis();
            // Of the turns that are the same, the one nearest to the last.
            let last = turns.last().copied().unwrap_or(more);
            let around = more.normalize_or_zero() * std::f64::consts::TAU;
            let same = [more, more - around, more + around];
            turns.push(same.into_iter().min_by(|a, b| a.distance(last).total_cmp(&b.distance(last))).unwrap_or(more));
        }
        let places: Vec<DVec3> = poses.iter().enumerate().map(|(at, pose)| pose.0 - self.assumed(at).0).collect();
        let smooth = |at: usize, values: &[DVec3]| {
            let near = at.saturating_sub(SMOOTH)..(at + SMOOTH + 1).min(values.len());
            let times: Vec<f64> = near.clone().map(|other| self.time(other) - self.time(at)).collect();
            fitted(&times, &values[near], 1)
        };
        let pose = |at: usize| {
            let (place, rotation) = self.assumed(at);
            let turn = DQuat::from_scaled_axis(smooth(at, &turns));
            (place + smooth(at, &places), (turn * rotation).normalize())
        };
        (0..poses.len()).map(pose).collect()
    }

    fn time(&self, at: usize) -> f64 {
        self.film.moments[self.shapes[at].moment].t_s
    }

    fn all(&self) -> Vec<usize> {
        (0..self.shapes.len()).collect()
    }

    /// Its poses by its motion alone.
    pub(super) fn all_assumed(&self) -> Vec<Pose> {
        (0..self.shapes.len()).map(|at| self.assumed(at)).collect()
    }

    /// The pose by its motion alone.
    fn assumed(&self, at: usize) -> Pose {
        (self.path.at(self.time(at)), self.turn.at(self.time(at)))
    }

    /// A pose at one instant, carried to another by its motion.
    fn carried(&self, (place, rotation): Pose, from: usize, to: usize) -> Pose {
        let ((path_from, turn_from), (path_to, turn_to)) = (self.assumed(from), self.assumed(to));
        let turn = turn_to * turn_from.conjugate();
        (path_to + turn * (place - path_from), (turn * rotation).normalize())
    }

    /// The pose at the last of three instants if it goes on from the second as it came to that from the first.
    fn as_before(&self, poses: &[Pose], [first, second, last]: [usize; 3]) -> Pose {
        let share = (self.time(last) - self.time(second)) / (self.time(second) - self.time(first));
        // What it turned more than its motion, it turns more again; its path is its motion's.
        let carried = self.carried(poses[first], first, second);
        let more = poses[second].1 * carried.1.conjugate();
        let more = if more.w < 0.0 { -more } else { more };
        let more = DQuat::from_scaled_axis(more.to_scaled_axis() * share);
        let (place, rotation) = self.carried(poses[second], second, last);
        (place, (more * rotation).normalize())
    }

    /// The turns far from a pose that fit an instant best, with what they cost.
    fn far(&self, points: &[SurfacePoint], at: usize, (place, rotation): Pose) -> Vec<(Pose, f64)> {
        let turns = rates(FAR_DIRECTIONS, &FAR_TURNS);
        let tried = turns.par_iter().skip(1).map(|&turn| {
            let pose = (place, (DQuat::from_scaled_axis(turn) * rotation).normalize());
            (pose, self.apart(points, at, pose))
        });
        let mut tried: Vec<(Pose, f64)> = tried.collect();
        tried.sort_by(|a, b| a.1.total_cmp(&b.1));
        tried.into_iter().take(FAR_KEPT).map(|(pose, _)| (pose, FAR_COSTS)).collect()
    }

    /// The poses soon after the exposure of an instant begins and soon before it ends, if a pose is that in its middle.
    pub(super) fn exposed(&self, at: usize, (place, rotation): Pose) -> [Pose; 2] {
        let (t_s, exposure_s) = (self.time(at), self.film.moments[self.shapes[at].moment].exposure_s);
        let (path, turn) = (self.path.at(t_s), self.turn.at(t_s).conjugate());
        [-0.5, 0.5].map(|side| {
            let t_s = t_s + side * EXPOSED * exposure_s;
            (place + self.path.at(t_s) - path, self.turn.at(t_s) * turn * rotation)
        })
    }

    fn carve(&self, poses: &[Pose], known: &[usize]) -> Option<Carved> {
        // A cell of the hulls is two or three pixels wide: cells of about one, but of a thing no more than some thousand.
        self.carve_cells(poses, known, (0.36 * self.film.cell_m).max(0.045 * self.radius_m))
    }

    /// Its shape by poses at some of its shapes, in cells of a size.
    pub(super) fn carve_cells(&self, poses: &[Pose], known: &[usize], cell_m: f64) -> Option<Carved> {
        let place = |&at: &usize| {
            let exposed = self.exposed(at, poses[at]);
            Place { moment: self.shapes[at].moment, centre: poses[at].0, rotation: poses[at].1, exposed }
        };
        let places: Vec<Place> = known.iter().map(place).collect();
        let (centre, rotation) = poses[self.best];
        let shape = &self.shapes[self.best];
        let hull: Vec<DVec3> =
            shape.places.iter().map(|&about| rotation.conjugate() * (shape.centre + about - centre)).collect();
        if let Some(ball) = self.ball {
            return Some(carve::ball(self.film, &places, [ball.radius_m, cell_m], ball.agree()));
        }
        carve::carve(self.film, &hull, &places, cell_m)
    }

    /// The pose near `start` at which a shape fits the frames of an instant best, and how far its colours are apart then, with what
    /// it costs to be away from the start.
    fn aligned(&self, points: &[SurfacePoint], at: usize, start: Pose) -> (Pose, f64) {
        let away = |moved: &[f64; 6]| {
            let of = |range: &[f64], step: f64| range.iter().map(|value| (value / step).powi(2)).sum::<f64>();
            AWAY_COSTS * (of(&moved[..3], TURN_STEP) + of(&moved[3..], PLACE_STEP))
        };
        let pose = |moved: &[f64; 6]| {
            let [a, b, c, x, y, z] = *moved;
            let turn = DQuat::from_scaled_axis(DVec3::new(a, b, c));
            (start.0 + self.radius_m * DVec3::new(x, y, z), turn * start.1)
        };
        let cost = |moved: &[f64; 6]| self.apart(points, at, pose(moved)) + away(moved);
        let changed = |moved: &[f64; 6], number: usize, step: f64| {
            let mut next = *moved;
            next[number] += step * if number < 3 { TURN_STEP } else { PLACE_STEP };
            next
        };
        let (moved, best) = STEPS.descend([0.0; 6], 6, changed, cost);
        (pose(&moved), best)
    }

    /// How far the colours of a shape at a pose are apart from the frames of an instant, in the mean over what faces each camera.
    pub(super) fn apart(&self, points: &[SurfacePoint], at: usize, (centre, rotation): Pose) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        let step = points.len().div_ceil(MOST_POINTS).max(1);
        let exposed = self.exposed(at, (centre, rotation));
        for point in points.iter().step_by(step) {
            let (place, normal) =
                (rotation * DVec3::from(point.position_m) + centre, rotation * DVec3::from(point.normal));
            let ends = exposed.map(|(centre, rotation)| rotation * DVec3::from(point.position_m) + centre);
            for view in &self.film.moments[self.shapes[at].moment].views {
                let eye = &self.film.eyes[view.eye];
                let facing = (eye.centre - place).normalize_or_zero().dot(normal);
                if facing <= 0.0 {
                    continue;
                }
                let Some(pixel) = eye.pixel(place) else { continue };
                // A blurred silhouette is longer than the thing: it is inside while the shutter is open.
                let inside = ends.iter().all(|&end| eye.pixel(end).is_none_or(|pixel| view.moving[pixel]));
                let moves = inside && view.moving[pixel];
                sum += facing * if moves { view.apart(pixel, point.colour) } else { MOST_APART };
                weights += facing;
            }
        }
        if weights > 0.0 { sum / weights } else { MOST_APART }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{carve::tests::film, turn::directions};

    #[test]
    fn a_ball_is_followed_though_its_rate_and_its_path_are_wrong() {
        let (radius, rate) = (0.2, DVec3::new(6.0, 1.0, 0.5));
        let true_pose = |t_s: f64| {
            let centre = DVec3::new(2.0 * t_s - 0.3, 0.05, 0.2 * t_s);
            (centre, DQuat::from_scaled_axis(rate * (t_s - 0.15)))
        };
        let times: Vec<f64> = (0..7).map(|at| 0.05 * at as f64).collect();
        let places: Vec<Place> = times
            .iter()
            .enumerate()
            .map(|(moment, &t_s)| {
                let (centre, rotation) = true_pose(t_s);
                Place { moment, centre, rotation, exposed: [(centre, rotation); 2] }
            })
            .collect();
        let mut film = film(radius, &places);
        for (moment, &t_s) in std::iter::zip(&mut film.moments, &times) {
            moment.t_s = t_s;
        }
        let hull: Vec<DVec3> = directions(1200).into_iter().map(|along| 1.15 * radius * along).collect();
        let shape = |(moment, place): (usize, &Place)| {
            let points = hull.iter().map(|about| (place.centre + *about, [128; 3]));
            Shape::new(moment, place.centre, points)
        };
        let shapes: Vec<Shape> = places.iter().enumerate().map(shape).collect();
        // The rate is wrong by a third, which adds up to a radian at the ends; the path by a tenth of the ball.
        let turn = Turn::steady(0.15, 0.65 * rate);
        let wrong = |(at, place): (usize, &Place)| place.centre + DVec3::Y * if at % 2 == 0 { 0.02 } else { -0.02 };
        let path = Path::new(times.clone(), places.iter().enumerate().map(wrong).collect());
        let best = 3;
        let grower =
            Grower { film: &film, shapes: &shapes, path: &path, turn: &turn, best, radius_m: radius, ball: None };
        let grown = grower.grow().unwrap();
        assert!(grown.apart[1] < 0.6 * grown.apart[0], "{:?}", grown.apart);
        let middle = grown.poses[best];
        for (at, pose) in grown.poses.iter().enumerate() {
            // Red above and blue below do not tell how it turns about the axis through both, nor where its frame has its origin.
            let (centre, rotation) = true_pose(times[at]);
            let (best_centre, best_rotation) = true_pose(times[best]);
            let axis = |rotation: DQuat, own: DQuat| rotation * own.conjugate() * best_rotation * DVec3::Y;
            let angle = axis(pose.1, middle.1).angle_between(rotation * DVec3::Y);
            assert!(angle < 0.2, "{angle} rad at {at}");
            let own = middle.1.conjugate() * (best_centre - middle.0);
            assert!((pose.1 * own + pose.0).distance(centre) < 0.02, "{at}");
        }
    }
}
