//! Gaussians that are born at an instant with a velocity, from points that are known to move.
//!
//! Points of one instant know those of the next by place and colour. Nearest neighbours alone pair a fast hand with what
//! stood where it arrives, so the points move together first and apart later: each round, every point looks for its nearest
//! from where it is thought to go, and takes the mean displacement of the points around it, of ever fewer of them (iterated
//! closest points, from rigid to free).

use std::iter::zip;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::shutter::shrunk;
use crate::scene::Point;
use erfgs_splat::{
    gaussians::{CORE, Gaussians, Neighbours},
    motion::{
        FreeTimeOptions,
        track::{Track, along},
    },
};

/// Points that take their mean displacement together, and in how many rounds. The first rounds are many: each brings a thing
/// that moves by more than its size only a part of its way.
const TOGETHER: [(usize, usize); 3] = [(64, 16), (32, 4), (16, 2)];

/// Farther from the origin than this, in metres, lies nothing that a sum of squares could hold.
const FARTHEST_M: f32 = 1e12;

/// A point that moves, and the instant it was there, RGB intervals.
pub type MovingPoint = (Point, f64);

/// The Gaussians of `points`: of the size of the spacing of their instant's points, and `options.between` times more on their ways to the
/// next instant, where these are known. The points are from frames that were exposed for `exposure` RGB intervals.
#[must_use]
pub fn gaussians(
    points: &[MovingPoint],
    sh_degree: u32,
    extent: f32,
    exposure: f32,
    options: &FreeTimeOptions,
) -> Gaussians {
    let instants = by_instant(points);
    let flows = flows(&instants, options.fastest * extent);
    let velocities = velocities(&instants, &flows);
    let mut all = Gaussians { sh_degree, motion_floats: options.floats(), ..Gaussians::default() };
    let reach = options.knots as f32 * options.spacing;
    let trees: Vec<Tree> = if options.knots == 0 { Vec::new() } else { instants.par_iter().map(tree).collect() };
    for (index, ((time, points), velocities)) in instants.iter().zip(velocities).enumerate() {
        let time = *time as f32;
        let there = shrunk(points, &velocities, exposure);
        if options.knots == 0 {
            place(&mut all, &there, options.opacity);
            all.motion.extend(velocities.into_iter().flat_map(|velocity| options.born(time, velocity)));
            continue;
        }
        let tracks = tracks(&instants, &flows, &trees, index, reach);
        follow(&mut all, &there, &tracks, [time, 0.0], options);
        let Some((away, moved)) = &flows[index][1] else { continue };
        let (points, tracks): (Vec<Point>, Vec<Track>) =
            zip(zip(there, tracks), moved).filter_map(|(pair, moved)| moved.is_some().then_some(pair)).unzip();
        for step in 1..=options.between {
            let since = away * step as f32 / (options.between + 1) as f32;
            follow(&mut all, &points, &tracks, [time, since], options);
        }
    }
    all.dynamic = all.core.len() / CORE;
    all
}

/// Adds Gaussians at `points`.
fn place(all: &mut Gaussians, points: &[Point], opacity: f32) {
    let born = Gaussians::from_points(points, all.sh_degree, opacity);
    all.core.extend(born.core);
    all.sh.extend(born.sh);
}

/// Adds Gaussians where `points` of the instant `time` are `since` intervals later on their `tracks`, and go on from there.
fn follow(all: &mut Gaussians, points: &[Point], tracks: &[Track], [time, since]: [f32; 2], options: &FreeTimeOptions) {
    let ways: Vec<Vec3> = tracks.iter().map(|track| along(track, since).into()).collect();
    let moved: Vec<Point> =
        zip(points, &ways).map(|((place, colour), way)| ((Vec3::from(*place) + *way).to_array(), *colour)).collect();
    place(all, &moved, options.opacity);
    for (track, from) in zip(tracks, ways) {
        let path = |dt: f32| (Vec3::from(along(track, since + dt)) - from).to_array();
        all.motion.extend(options.bent(time + since, path));
    }
}

/// How a point goes by its neighbouring instants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// Where it is at its own.
    pub place: [f32; 3],
    /// Metres an interval.
    pub speed: f32,
    /// How much its velocity changes from the instant before to the one after, as a share of the mean of both speeds; where it was
    /// found at both. Pairs of chance have the square root of two in the median.
    pub bend: Option<f32>,
}

/// How points that move go; none faster than `fastest`, metres an interval.
#[must_use]
pub fn ways(points: &[MovingPoint], fastest: f32) -> Vec<Way> {
    let instants = by_instant(points);
    let flows = flows(&instants, fastest);
    let velocities = velocities(&instants, &flows);
    let mut ways = Vec::new();
    for (((_, points), sides), velocities) in instants.iter().zip(&flows).zip(velocities) {
        let side = |side: usize, at: usize| speed(&sides[side], at).map(|(_, velocity)| Vec3::from(velocity));
        ways.extend(points.iter().zip(velocities).enumerate().map(|(at, ((place, _), velocity))| {
            let bend = side(0, at).zip(side(1, at)).map(|(before, after)| {
                let mean = 0.5 * (before.length() + after.length());
                (after - before).length() / mean.max(f32::MIN_POSITIVE)
            });
            Way { place: *place, speed: Vec3::from(velocity).length(), bend }
        }));
    }
    ways
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

/// Where the points of an instant go by a neighbouring one: how many intervals away that is (before: less than 0), and the displacement
/// of each point, where it is known.
type Flow = (f32, Vec<Option<[f32; 3]>>);

/// The flows of each instant to the one before and to the one after, none faster than `fastest`, metres an interval.
fn flows(instants: &[Instant], fastest: f32) -> Vec<[Option<Flow>; 2]> {
    instants
        .par_iter()
        .enumerate()
        .map(|(index, (time, points))| {
            let towards = |other: Option<&Instant>| {
                let (then, others) = other?;
                let away = (then - time) as f32;
                Some((away, displacements(points, others, fastest * away.abs())))
            };
            [towards(index.checked_sub(1).and_then(|index| instants.get(index))), towards(instants.get(index + 1))]
        })
        .collect()
}

/// The velocity of each point of each instant, metres an interval: where it is found both before and after, that of the parabola
/// through the three places. The parabola's acceleration is left alone: its error grows with the square of the time, and Gaussians
/// that started with it ended worse where things move.
fn velocities(instants: &[Instant], flows: &[[Option<Flow>; 2]]) -> Vec<Vec<[f32; 3]>> {
    zip(instants, flows)
        .map(|((_, points), [before, after])| {
            (0..points.len())
                .map(|at| match (speed(before, at), speed(after, at)) {
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

/// How far away the neighbouring instant is, intervals, and the velocity that a point has by it, metres an interval.
fn speed(side: &Option<Flow>, at: usize) -> Option<(f32, [f32; 3])> {
    let (away, moved) = side.as_ref()?;
    Some((*away, moved[at]?.map(|moved| moved / away)))
}

/// A place and a colour as one place, in which white against black counts as much as a way of `255 tint` along each axis.
fn joint(place: [f32; 3], colour: [u8; 3], tint: f32) -> [f32; 6] {
    std::array::from_fn(|k| if k < 3 { place[k] } else { tint * f32::from(colour[k - 3]) })
}

type Tree = ImmutableKdTree<f32, 6>;

/// How much a colour counts where a flow is followed.
const TINT: f32 = 0.5 / 255.0;

/// The points of an instant, by place and colour.
fn tree((_, points): &Instant) -> Tree {
    let places: Vec<[f32; 6]> = points.iter().map(|(place, colour)| joint(*place, *colour, TINT)).collect();
    Tree::new_from_slice(&places)
}

/// The tracks of the points of instant `index`, `reach` intervals to either side where they are known so far: from each instant
/// to the next by the flow of the points that are there, as the nearest of them in place and colour go.
fn tracks(instants: &[Instant], flows: &[[Option<Flow>; 2]], trees: &[Tree], index: usize, reach: f32) -> Vec<Track> {
    /// Points of an instant whose flow is followed.
    const FOLLOWED: usize = 4;
    let (_, points) = &instants[index];
    let mut tracks: Vec<Track> = vec![vec![(0.0, [0.0; 3])]; points.len()];
    for (side, step) in [(0, -1_isize), (1, 1)] {
        let mut at = index;
        let mut since = 0.0;
        while let Some((away, moved)) = &flows[at][side] {
            if since * step as f32 >= reach {
                break;
            }
            let Some(followed) = std::num::NonZero::new(FOLLOWED.min(instants[at].1.len())) else { break };
            tracks.par_iter_mut().zip(points).enumerate().for_each(|(own, (track, (place, colour)))| {
                // A track that was lost before goes no farther.
                let Some(&(last, from)) = (if side == 0 { track.first() } else { track.last() }) else { return };
                if (last - since).abs() > 1e-6 {
                    return;
                }
                let known: Vec<[f32; 3]> = if at == index {
                    moved[own].into_iter().collect()
                } else {
                    let here = joint(std::array::from_fn(|axis| place[axis] + from[axis]), *colour, TINT);
                    let near = trees[at].nearest_n::<SquaredEuclidean>(&here, followed);
                    near.into_iter().filter_map(|found| moved[found.item as usize]).collect()
                };
                if known.is_empty() {
                    return;
                }
                let mean = |axis: usize| known.iter().map(|way| way[axis]).sum::<f32>() / known.len() as f32;
                let next = (since + away, std::array::from_fn(|axis| from[axis] + mean(axis)));
                if side == 0 { track.insert(0, next) } else { track.push(next) }
            });
            since += away;
            at = at.saturating_add_signed(step);
        }
    }
    tracks
}

/// Where each of `points` goes among `others`, as a displacement; none where it would go farther than `farthest`.
fn displacements(points: &[Point], others: &[Point], farthest: f32) -> Vec<Option<[f32; 3]>> {
    if others.is_empty() || farthest <= 0.0 {
        return vec![None; points.len()];
    }
    // White against black counts as much as twice the farthest way.
    let tint = 2.0 * farthest / 255.0 / 3.0_f32.sqrt();
    let targets: Vec<[f32; 6]> = others.iter().map(|(place, colour)| joint(*place, *colour, tint)).collect();
    let target_tree = Tree::new_from_slice(&targets);
    let nearest = |tree: &Tree, at: &[f32; 6]| tree.nearest_one::<SquaredEuclidean>(at).item as usize;
    let places: Vec<[f32; 3]> = points.iter().map(|(place, _)| *place).collect();
    let around = Neighbours::new(&places);
    let most = TOGETHER.iter().map(|(together, _)| *together).max().unwrap_or(1);
    let nearby: Vec<Vec<usize>> = places
        .par_iter()
        .map(|place| around.nearest(place, most).into_iter().map(|(index, _)| index).collect())
        .collect();
    let mut moved = vec![[0.0_f32; 3]; points.len()];
    for together in TOGETHER.into_iter().flat_map(|(together, rounds)| std::iter::repeat_n(together, rounds)) {
        let from: Vec<[f32; 6]> = zip(points, &moved)
            .map(|((place, colour), moved)| joint(std::array::from_fn(|k| place[k] + moved[k]), *colour, tint))
            .collect();
        let source_tree = Tree::new_from_slice(&from);
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
    use erfgs_splat::motion::free_time::ROW;

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
    fn what_falls_is_born_on_its_way_through_the_instants_before_and_after() {
        let height = |t: f32| 0.5 - 0.2 * t + 0.15 * t * t;
        let points: Vec<MovingPoint> = (0..5)
            .flat_map(|t| ball(t, [0.4 * t as f32, height(t as f32), 0.0], [200, 20, 20]).map(move |p| (p, t as f64)))
            .collect();
        let options = FreeTimeOptions { knots: 2, ..FreeTimeOptions::default() };
        let born = gaussians(&points, 0, 4.0, 0.0, &options);
        assert_eq!(born.motion.len(), 300 * options.floats());
        for (index, row) in born.motion.chunks_exact(options.floats()).enumerate() {
            let t = (index / 60) as f32;
            assert_eq!(row[3], t, "the instant");
            // Where its way is known: from the first instant to the last.
            for dt in [-2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0] {
                if (0.0..=4.0).contains(&(t + dt)) {
                    let [x, y, _] = options.moved(row, dt);
                    let (fell, went) = (height(t + dt) - height(t), 0.4 * dt);
                    assert!(
                        (x - went).abs() < 0.08 && (y - fell).abs() < 0.08,
                        "{index} at {dt}: {x} {y}, not {went} {fell}"
                    );
                }
            }
        }
    }

    #[test]
    fn between_two_instants_it_is_born_where_its_path_leads() {
        let at = |t: f32| [0.4 * t, 0.5 - 0.2 * t + 0.05 * t * t];
        let points: Vec<MovingPoint> = (0..5)
            .flat_map(|t| {
                let [x, y] = at(t as f32);
                ball(t, [x, y, 0.0], [200, 20, 20]).map(move |point| (point, t as f64))
            })
            .collect();
        let options = FreeTimeOptions { knots: 2, between: 1, ..FreeTimeOptions::default() };
        let born = gaussians(&points, 0, 4.0, 0.0, &options);
        let rows: Vec<&[f32]> = born.motion.chunks_exact(options.floats()).collect();
        // Nothing is known of the way after the last instant.
        assert_eq!((born.len(), rows.len()), (540, 540));
        for (group, row) in rows.chunks(60).enumerate() {
            let t = 0.5 * group as f32;
            assert!(row.iter().all(|row| row[3] == t), "the instant of group {group}");
            let core = &born.core[group * 60 * CORE..][..60 * CORE];
            let mean = |axis: usize| core.iter().skip(axis).step_by(CORE).sum::<f32>() / 60.0;
            let [x, y] = at(t);
            assert!((mean(0) - x).abs() < 0.03 && (mean(1) - y).abs() < 0.03, "{t}: {} {}", mean(0), mean(1));
            for dt in [-1.0, -0.5, 0.5, 1.0].into_iter().filter(|dt| (0.0..=4.0).contains(&(t + dt))) {
                let [then_x, then_y] = at(t + dt);
                for row in row {
                    let [went, rose, _] = options.moved(row, dt);
                    assert!((went - then_x + x).abs() < 0.08 && (rose - then_y + y).abs() < 0.08, "{t} and {dt}");
                }
            }
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
