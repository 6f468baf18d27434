//! Gaussians that are born at an instant with a velocity, from points that are known to move.
//!
//! Points of one instant know those of the next by place and colour. Nearest neighbours alone pair a fast hand with what
//! stood where it arrives, so the points move together first and apart later: each round, every point looks for its nearest
//! from where it is thought to go, and takes the mean displacement of the points around it, of ever fewer of them (iterated
//! closest points, from rigid to free).

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::{
    free_time::{FreeTimeOptions, ROW},
    shutter::shrunk,
};
use crate::{
    gaussians::{CORE, Gaussians, Neighbours},
    scene::Point,
};

/// Points that take their mean displacement together, and in how many rounds. The first rounds are many: each brings a thing
/// that moves by more than its size only a part of its way.
const TOGETHER: [(usize, usize); 3] = [(64, 16), (32, 4), (16, 2)];

/// Farther from the origin than this, in metres, lies nothing that a sum of squares could hold.
const FARTHEST_M: f32 = 1e12;

/// A point that moves, and the instant it was there, RGB intervals.
pub type MovingPoint = (Point, f64);

/// The Gaussians of `points`, in the order of their instants: of the size of the spacing of their instant's points. The
/// points are from frames that were exposed for `exposure` RGB intervals.
#[must_use]
pub fn gaussians(
    points: &[MovingPoint],
    sh_degree: u32,
    extent: f32,
    exposure: f32,
    options: &FreeTimeOptions,
) -> Gaussians {
    let instants = by_instant(points);
    let velocities = velocities(&instants, options.fastest * extent);
    let mut all = Gaussians { sh_degree, motion_floats: ROW, ..Gaussians::default() };
    let log_life = log_life(options);
    for ((time, points), velocities) in instants.iter().zip(velocities) {
        let points = shrunk(points, &velocities, exposure);
        let born = Gaussians::from_points(&points, sh_degree, options.opacity);
        all.core.extend(born.core);
        all.sh.extend(born.sh);
        for [x, y, z] in velocities {
            all.motion.extend([x, y, z, *time as f32, 0.0, 0.0, 0.0, log_life]);
        }
    }
    all.dynamic = all.core.len() / CORE;
    all
}

/// What a row stores of the life that a Gaussian starts with.
#[must_use]
pub fn log_life(options: &FreeTimeOptions) -> f32 {
    (options.first_life - options.least_life).max(1e-3).ln()
}

type Instant = (f64, Vec<Point>);

fn by_instant(points: &[MovingPoint]) -> Vec<Instant> {
    let mut order: Vec<&MovingPoint> = points
        .iter()
        .filter(|((position, _), time)| time.is_finite() && position.iter().all(|p| p.abs() < FARTHEST_M))
        .collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    order
        .chunk_by(|a, b| (a.1 - b.1).abs() < 1e-6)
        .map(|chunk| (chunk[0].1, chunk.iter().map(|(point, _)| *point).collect()))
        .collect()
}

/// The velocity of each point of each instant, metres an interval, none faster than `fastest`: where it is found both before
/// and after, that of the parabola through the three places. The parabola's acceleration is left alone: its error grows with the
/// square of the time, and Gaussians that started with it ended worse where things move.
fn velocities(instants: &[Instant], fastest: f32) -> Vec<Vec<[f32; 3]>> {
    instants
        .par_iter()
        .enumerate()
        .map(|(index, (time, points))| {
            // Displacements to a neighbour, and how many intervals away it is (before: less than 0).
            let towards = |other: Option<&Instant>| {
                let (then, others) = other?;
                let away = (then - time) as f32;
                Some((away, displacements(points, others, fastest * away.abs())))
            };
            let before = towards(index.checked_sub(1).and_then(|index| instants.get(index)));
            let after = towards(instants.get(index + 1));
            let speed = |side: &Option<(f32, Vec<Option<[f32; 3]>>)>, at: usize| {
                let (away, moved) = side.as_ref()?;
                Some((*away, moved[at]?.map(|moved| moved / away)))
            };
            (0..points.len())
                .map(|at| match (speed(&before, at), speed(&after, at)) {
                    (Some((back, a)), Some((on, b))) => {
                        std::array::from_fn(|axis| (a[axis] * on - b[axis] * back) / (on - back))
                    }
                    (Some((_, velocity)), None) | (None, Some((_, velocity))) => velocity,
                    (None, None) => [0.0; 3],
                })
                .collect()
        })
        .collect()
}

/// Where each of `points` goes among `others`, as a displacement; none where it would go farther than `farthest`.
fn displacements(points: &[Point], others: &[Point], farthest: f32) -> Vec<Option<[f32; 3]>> {
    if others.is_empty() || farthest <= 0.0 {
        return vec![None; points.len()];
    }
    // White against black counts as much as twice the farthest way.
    let tint = 2.0 * farthest / 255.0 / 3.0_f32.sqrt();
    let joint = |(place, colour): &Point, moved: &[f32; 3]| -> [f32; 6] {
        std::array::from_fn(|k| match k {
            0..3 => place[k] + moved[k],
            _ => tint * f32::from(colour[k - 3]),
        })
    };
    let targets: Vec<[f32; 6]> = others.iter().map(|other| joint(other, &[0.0; 3])).collect();
    let target_tree: ImmutableKdTree<f32, 6> = ImmutableKdTree::new_from_slice(&targets);
    let nearest =
        |tree: &ImmutableKdTree<f32, 6>, at: &[f32; 6]| tree.nearest_one::<SquaredEuclidean>(at).item as usize;
    let places: Vec<[f32; 3]> = points.iter().map(|(place, _)| *place).collect();
    let around = Neighbours::new(&places);
    let most = TOGETHER.iter().map(|(together, _)| *together).max().unwrap_or(1);
    let nearby: Vec<Vec<usize>> = places
        .par_iter()
        .map(|place| around.nearest(place, most).into_iter().map(|(index, _)| index).collect())
        .collect();
    let mut moved = vec![[0.0_f32; 3]; points.len()];
    for together in TOGETHER.into_iter().flat_map(|(together, rounds)| std::iter::repeat_n(together, rounds)) {
        let from: Vec<[f32; 6]> = std::iter::zip(points, &moved).map(|(point, moved)| joint(point, moved)).collect();
        let source_tree: ImmutableKdTree<f32, 6> = ImmutableKdTree::new_from_slice(&from);
        // Of each point the sum of the ways to its partners, and how many they are: its own choice, and all that choose it.
        // Without the latter a long thing that moves along itself would hardly move: most of it has somewhere to be.
        let mut pulls = vec![[0.0_f32; 4]; points.len()];
        let mut pull = |index: usize, other: usize| {
            let [x, y, z, count] = &mut pulls[index];
            for ((sum, to), from) in [x, y, z].into_iter().zip(others[other].0).zip(points[index].0) {
                *sum += to - from;
            }
            *count += 1.0;
        };
        for (index, other) in
            from.par_iter().map(|at| nearest(&target_tree, at)).collect::<Vec<_>>().into_iter().enumerate()
        {
            pull(index, other);
        }
        for (other, index) in
            targets.par_iter().map(|at| nearest(&source_tree, at)).collect::<Vec<_>>().into_iter().enumerate()
        {
            pull(index, other);
        }
        moved = nearby
            .par_iter()
            .map(|near| {
                let near = &near[..together.min(near.len())];
                let sum = |at: usize| near.iter().map(|&index| pulls[index][at]).sum::<f32>();
                std::array::from_fn(|axis| sum(axis) / sum(3))
            })
            .collect();
    }
    let length = |d: &[f32; 3]| d.iter().map(|d| d * d).sum::<f32>().sqrt();
    moved.into_iter().map(|moved| (length(&moved) <= farthest).then_some(moved)).collect()
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    /// Points in a ball around `centre`, of about `colour`.
    fn ball(seed: u64, centre: [f32; 3], colour: [u8; 3]) -> impl Iterator<Item = Point> {
        (0..60).map(move |i| {
            let at = |axis: u64| random::range(random::key(seed, &[i, axis]), -0.1, 0.1) as f32;
            let place = [centre[0] + at(0), centre[1] + at(1), centre[2] + at(2)];
            let shade = (random::uniform(random::key(seed, &[i, 9])) * 12.0) as u8;
            (place, colour.map(|c| c.saturating_add(shade)))
        })
    }

    #[test]
    fn things_go_where_things_like_them_are_next() {
        // Two balls that pass each other, the red one three of its widths an interval.
        let at = |t: f32| {
            let red = ball(3 + t as u64, [0.6 * t - 0.6, 0.0, 0.0], [200, 20, 20]);
            red.chain(ball(77 + t as u64, [0.0, 0.2 * t, 0.3], [20, 20, 200])).map(move |point| (point, f64::from(t)))
        };
        let points: Vec<MovingPoint> = (0..3).flat_map(|t| at(t as f32)).collect();
        let born = gaussians(&points, 0, 4.0, 0.0, &FreeTimeOptions::default());
        assert_eq!((born.len(), born.dynamic, born.motion.len()), (360, 360, 360 * ROW));
        for (index, row) in born.motion.chunks_exact(ROW).enumerate() {
            let expected = if index % 120 < 60 { [0.6, 0.0, 0.0] } else { [0.0, 0.2, 0.0] };
            for axis in 0..3 {
                assert!((row[axis] - expected[axis]).abs() < 0.1, "{index}: {row:?} instead of {expected:?}");
            }
            assert_eq!(row[3], (index / 120) as f32, "the instant");
        }
        assert!((born.opacity(7) - 0.2).abs() < 1e-6);
        // The spacing is that of one instant: with all of them a spot would be smaller.
        assert!(born.scale(7)[0] > 0.02, "{}", born.scale(7)[0]);
    }

    #[test]
    fn what_falls_is_born_with_its_speed_at_that_instant() {
        let height = |t: f32| 0.5 - 0.2 * t + 0.15 * t * t;
        let points: Vec<MovingPoint> = (0..4)
            .flat_map(|t| ball(t, [0.4 * t as f32, height(t as f32), 0.0], [200, 20, 20]).map(move |p| (p, t as f64)))
            .collect();
        let born = gaussians(&points, 0, 4.0, 0.0, &FreeTimeOptions::default());
        for (index, row) in born.motion.chunks_exact(ROW).enumerate().filter(|(index, _)| (60..180).contains(index)) {
            let t = (index / 60) as f32;
            assert!((row[1] - (0.3 * t - 0.2)).abs() < 0.06, "{index}: {row:?}");
        }
    }

    #[test]
    fn what_would_be_too_fast_stands_still() {
        let options = FreeTimeOptions { fastest: 0.01, ..Default::default() };
        let points: Vec<MovingPoint> = ball(1, [0.0; 3], [9; 3])
            .map(|point| (point, 0.0))
            .chain(ball(1, [2.0, 0.0, 0.0], [9; 3]).map(|point| (point, 1.0)))
            .collect();
        let born = gaussians(&points, 1, 4.0, 0.0, &options);
        assert!(born.motion.chunks_exact(ROW).all(|row| row[..3] == [0.0; 3]));
    }

    #[test]
    fn odd_points_are_taken_or_left_without_failing() {
        let options = FreeTimeOptions::default();
        assert!(gaussians(&[], 0, 1.0, 0.0, &options).is_empty());
        let one = |place: [f32; 3], time| ((place, [1, 2, 3]), time);
        let points = [one([0.0; 3], 1.0), one([f32::NAN; 3], 1.0), one([1e30; 3], 2.0), one([0.0; 3], f64::NAN)];
        let born = gaussians(&points, 0, 1.0, 0.0, &options);
        assert_eq!(born.len(), 1);
        assert!(born.motion.iter().all(|value| value.is_finite()));
    }
}
