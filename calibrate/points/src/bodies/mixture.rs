//! A mixture of flights: points of several things at several instants, each thing with a place and a velocity of its own, and all of
//! them with one acceleration. Fitted by expectation and maximisation from many guesses.

use erfgs_base::random;
use glam::DVec3;

use super::{
    flight::{fitted, sum},
    parts::settled,
};

/// Flights begin at so many guesses, each with so many points of an instant, and the best goes on with all points.
const GUESSES: usize = 60;
const FEW_POINTS: usize = 100;
/// Rounds of expectation and maximisation of a guess, and of the best.
const ROUNDS: usize = 25;
/// How far points are from the middle of their thing along an axis at first, metres, and in spacings at least.
const FIRST_SPREAD_M: f64 = 0.12;
const LEAST_SPREAD: f64 = 1.5;

/// The points of each instant.
#[derive(Clone, Copy, Debug)]
pub struct PointClouds<'a> {
    /// The instants, seconds.
    pub times_s: &'a [f64],
    /// Places at each, metres.
    pub points: &'a [Vec<DVec3>],
    /// How far points of a thing are apart, metres.
    pub cell_m: f64,
}

/// Flights of things.
#[derive(Clone, Debug)]
pub struct Mixture {
    /// Where each thing is at each instant, metres.
    pub places: Vec<Vec<DVec3>>,
    /// How far its points are from there along each axis, the root of the mean square, metres.
    pub spreads_m: Vec<f64>,
    /// The mean logarithm of how likely points are.
    likelihood: f64,
}

/// What the points of an instant say of a thing: how many they are, their sum, and the squares of their distances.
#[derive(Clone, Copy, Default)]
struct Share {
    weight: f64,
    sum: DVec3,
    squares: f64,
}

impl Mixture {
    /// The mixture of so many flights that makes points likeliest; none if they are too few.
    pub fn of(seen: PointClouds<'_>, count: usize) -> Option<Self> {
        let few: Vec<Vec<DVec3>> = seen.points.iter().map(|points| thinned(points)).collect();
        let few = PointClouds { points: &few, ..seen };
        let tried = |guess: usize| {
            let first = Self::guess(few, count, random::key(guess as u64, &[count as u64]))?;
            (0..ROUNDS).try_fold(first, |mixture, _| mixture.nearer(few))
        };
        let best = (0..GUESSES).filter_map(tried).max_by(|a, b| a.likelihood.total_cmp(&b.likelihood))?;
        (0..ROUNDS).try_fold(best, |mixture, _| mixture.nearer(seen))
    }

    /// The thing that a point of an instant is most surely of.
    pub fn owner(&self, instant: usize, point: DVec3) -> usize {
        let (weights, _) = self.weights(instant, point);
        (0..weights.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap_or(0)
    }

    /// Straight flights through parts of the points of two instants.
    fn guess(seen: PointClouds<'_>, count: usize, key: u64) -> Option<Self> {
        let full: Vec<usize> = (0..seen.points.len()).filter(|&at| seen.points[at].len() >= count).collect();
        let order = random::permutation(key, full.len());
        let [from, to] = [*full.get(*order.first()?)?, *full.get(*order.get(1)?)?];
        let [here, there] =
            [from, to].map(|instant| middles(&seen.points[instant], count, random::extend(key, instant as u64)));
        let partners = random::permutation(random::extend(key, u64::MAX), count);
        let seconds = seen.times_s[to] - seen.times_s[from];
        let way = |thing: usize| {
            let velocity = (there[partners[thing]] - here[thing]) / seconds;
            seen.times_s.iter().map(|&time| here[thing] + velocity * (time - seen.times_s[from])).collect()
        };
        Some(Self {
            places: (0..count).map(way).collect(),
            spreads_m: vec![FIRST_SPREAD_M; count],
            likelihood: f64::NEG_INFINITY,
        })
    }

    /// After one round more.
    fn nearer(&self, seen: PointClouds<'_>) -> Option<Self> {
        let mut shares = vec![vec![Share::default(); seen.points.len()]; self.places.len()];
        let (mut likelihood, mut count) = (0.0, 0.0);
        for (instant, points) in seen.points.iter().enumerate() {
            for &point in points {
                let (weights, log) = self.weights(instant, point);
                likelihood += log;
                count += 1.0;
                for (thing, weight) in weights.into_iter().enumerate() {
                    let share = &mut shares[thing][instant];
                    share.weight += weight;
                    share.sum += weight * point;
                    share.squares += weight * point.distance_squared(self.places[thing][instant]);
                }
            }
        }
        let spread = |shares: &Vec<Share>| {
            let weight: f64 = shares.iter().map(|share| share.weight).sum();
            let squares: f64 = shares.iter().map(|share| share.squares).sum();
            (squares / (3.0 * weight.max(1e-9))).sqrt().max(LEAST_SPREAD * seen.cell_m)
        };
        let spreads_m = shares.iter().map(spread).collect();
        let places = flown(seen.times_s, &shares)?;
        let finite = places.iter().flatten().all(|place| place.is_finite());
        finite.then_some(Self { places, spreads_m, likelihood: likelihood / count })
    }

    /// How surely a point is of each thing, and the logarithm of how likely it is at all.
    fn weights(&self, instant: usize, point: DVec3) -> (Vec<f64>, f64) {
        let log = |(places, spread): (&Vec<DVec3>, &f64)| {
            -point.distance_squared(places[instant]) / (2.0 * spread * spread) - 3.0 * spread.ln()
        };
        let mut weights: Vec<f64> = std::iter::zip(&self.places, &self.spreads_m).map(log).collect();
        let top = weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        weights.iter_mut().for_each(|weight| *weight = (*weight - top).exp());
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|weight| *weight /= sum);
        (weights, top + sum.ln())
    }
}

/// Where things are at the instants if each flies, all with the acceleration that suits them all.
fn flown(times_s: &[f64], shares: &[Vec<Share>]) -> Option<Vec<Vec<DVec3>>> {
    let row = |thing: usize, time: f64| {
        let after = time - times_s[0];
        let mut row = vec![0.0; 2 * shares.len() + 1];
        [row[2 * thing], row[2 * thing + 1], row[2 * shares.len()]] = [1.0, after, 0.5 * after * after];
        row
    };
    let (mut rows, mut places) = (Vec::new(), Vec::new());
    for (thing, shares) in shares.iter().enumerate() {
        for (share, &time) in std::iter::zip(shares, times_s).filter(|(share, _)| share.weight > 1.0) {
            let root = share.weight.sqrt();
            rows.push(row(thing, time).into_iter().map(|value| root * value).collect());
            places.push(share.sum / root);
        }
    }
    let (terms, _) = fitted(&rows, &places)?;
    let way = |thing: usize| times_s.iter().map(|&time| sum(&row(thing, time), &terms)).collect();
    Some((0..shares.len()).map(way).collect())
}

fn thinned(points: &[DVec3]) -> Vec<DVec3> {
    points.iter().step_by(points.len().div_ceil(FEW_POINTS).max(1)).copied().collect()
}

/// Middles of so many parts of points, from random ones.
fn middles(points: &[DVec3], count: usize, key: u64) -> Vec<DVec3> {
    let order = random::permutation(key, points.len());
    settled(points, order.iter().take(count).map(|&at| points[at]).collect())
}
