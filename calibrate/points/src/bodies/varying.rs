//! A rate of turning that differs from one interval to the next: of free tops, and of what bounces.
//!
//! Between two instants a rate is as good as the colours of frames say, and the events around both. The best sequence of rates from a
//! grid, with a price on changes that a bounce pays only once, is found by dynamic programming, and then improved interval by interval.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use super::{
    contrast::{Change, Window, mean_contrast},
    near_events::Windows,
    refine::best_velocity,
    shades::{Compared as _, Shades},
    turn::{climb, rates},
};

/// Directions and rates of the grid, radians per second.
const DIRECTIONS: usize = 60;
const RATES: [f64; 7] = [2.5, 5.0, 8.0, 11.5, 15.0, 20.0, 26.0];
/// How much the contrast of events weighs, compared with the colours of frames.
const EVENTS_WEIGH: f64 = 3.0;
/// What a change of a radian per second from one interval to the next costs, and the most that a change costs.
const CHANGE_COSTS: f64 = 0.03;
const MOST_CHANGE: f64 = 0.5;
/// What turning at a radian per second costs, so that what is not seen to turn does not.
const RATE_COSTS: f64 = 0.003;
/// A rate that changes must be so much better at each interval in the mean than one that does not.
const BETTER: f64 = 0.08;

/// What tells how a thing turns.
pub struct Evidence<'a> {
    /// Colours, where there are enough points.
    pub shades: Option<&'a Shades<'a>>,
    /// Events around instants.
    pub windows: &'a Windows,
    /// The instants at which the thing is seen, with their times in seconds, ordered.
    pub instants: Vec<(usize, f64)>,
}

/// The events of an instant.
struct Around<'a> {
    windows: &'a [Window],
    velocity: DVec3,
    top: f64,
}

impl Around<'_> {
    fn sharp(&self, rate: DVec3) -> f64 {
        mean_contrast(self.windows, Change { rate, velocity: self.velocity }) / self.top
    }
}

/// Colours and events of all intervals.
struct Costs<'a> {
    evidence: &'a Evidence<'a>,
    /// How far colours are apart without a turn, in the mean.
    still: f64,
    around: BTreeMap<usize, Around<'a>>,
}

impl<'a> Costs<'a> {
    fn new(evidence: &'a Evidence<'a>) -> Self {
        let still = evidence.shades.map_or(1.0, |shades| shades.apart(&[DVec3::ZERO])[0]).max(1.0);
        let around = |(&moment, windows): (&usize, &'a Vec<Window>)| {
            let top = mean_contrast(windows, Change::default());
            (top > 0.0).then_some((moment, Around { windows, velocity: DVec3::ZERO, top }))
        };
        Self { evidence, still, around: evidence.windows.iter().filter_map(around).collect() }
    }

    fn between(&self, interval: usize) -> [(usize, f64); 2] {
        [self.evidence.instants[interval], self.evidence.instants[interval + 1]]
    }

    fn colours(&self, interval: usize, rate: DVec3) -> f64 {
        let instants = self.between(interval).map(|instant| instant.0);
        self.evidence
            .shades
            .and_then(|shades| shades.apart_between(instants, rate))
            .map_or(0.0, |apart| apart / self.still)
    }

    fn events(&self, interval: usize, sharp: impl Fn(usize, &Around<'_>) -> f64) -> f64 {
        let sharp =
            self.between(interval).map(|(moment, _)| self.around.get(&moment).map(|around| sharp(moment, around)));
        let both: Vec<f64> = sharp.into_iter().flatten().collect();
        both.iter().sum::<f64>() / both.len().max(1) as f64
    }

    fn at(&self, interval: usize, rate: DVec3) -> f64 {
        let sharp = self.events(interval, |_, around| around.sharp(rate));
        weighed(self.colours(interval, rate), sharp, rate)
    }
}

fn weighed(colours: f64, sharp: f64, rate: DVec3) -> f64 {
    colours - EVENTS_WEIGH * sharp + RATE_COSTS * rate.length()
}

fn change(a: DVec3, b: DVec3) -> f64 {
    (CHANGE_COSTS * a.distance(b)).min(MOST_CHANGE)
}

/// The rate in the middle of each interval, with its time; none where one rate, `steady`, explains what is seen as well.
pub fn varying(evidence: &Evidence<'_>, steady: DVec3) -> Option<Vec<(f64, DVec3)>> {
    let intervals = evidence.instants.len().checked_sub(1).filter(|&intervals| intervals >= 2)?;
    let mut costs = Costs::new(evidence);
    let mut grid = rates(DIRECTIONS, &RATES);
    grid.push(steady);
    let colours: Vec<Vec<f64>> =
        (0..intervals).map(|interval| grid.par_iter().map(|&rate| costs.colours(interval, rate)).collect()).collect();
    let mut found = vec![steady; intervals];
    // Twice: what the path says of velocities is wrong at first, and hides how the thing turns.
    for _ in 0..2 {
        for (index, &(moment, _)) in evidence.instants.iter().enumerate() {
            let rate = (found[index.saturating_sub(1)] + found[index.min(intervals - 1)]) / 2.0;
            let Some(around) = costs.around.get_mut(&moment) else { continue };
            let windows = around.windows;
            let usual = mean_contrast(windows, Change { rate, velocity: DVec3::ZERO }).max(f64::MIN_POSITIVE);
            around.velocity = best_velocity(windows, usual, Change { rate, velocity: around.velocity });
        }
        let sharp: BTreeMap<usize, Vec<f64>> = costs
            .around
            .iter()
            .map(|(&moment, around)| (moment, grid.par_iter().map(|&rate| around.sharp(rate)).collect()))
            .collect();
        let top = |moment: usize| sharp[&moment].iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let table: Vec<Vec<f64>> = (0..intervals)
            .map(|interval| {
                let one = |at: usize| {
                    let sharp = costs.events(interval, |moment, _| sharp[&moment][at] / top(moment));
                    weighed(colours[interval][at], sharp, grid[at])
                };
                (0..grid.len()).map(one).collect()
            })
            .collect();
        for (moment, around) in &mut costs.around {
            around.top *= top(*moment);
        }
        found = cheapest(&table, &grid).into_iter().map(|at| grid[at]).collect();
    }
    for _ in 0..2 {
        for interval in 0..intervals {
            let beside: Vec<DVec3> = [interval.checked_sub(1), Some(interval + 1)]
                .into_iter()
                .flatten()
                .filter_map(|at| found.get(at).copied())
                .collect();
            let score = |tries: &[DVec3]| -> Vec<f64> {
                let one = |&rate: &DVec3| {
                    -costs.at(interval, rate) - beside.iter().map(|&other| change(rate, other)).sum::<f64>()
                };
                tries.par_iter().map(one).collect()
            };
            let start = found[interval];
            found[interval] = climb((score(&[start])[0], start), 2.0, 3, score).1;
        }
    }
    let of = |rates: &[DVec3]| {
        let own: f64 = rates.iter().enumerate().map(|(interval, &rate)| costs.at(interval, rate)).sum();
        own + rates.windows(2).map(|both| change(both[0], both[1])).sum::<f64>()
    };
    let middle = |interval: usize| costs.between(interval).map(|instant| instant.1).iter().sum::<f64>() / 2.0;
    let better = of(&vec![steady; intervals]) - of(&found);
    (better > BETTER * intervals as f64)
        .then(|| found.iter().enumerate().map(|(at, &rate)| (middle(at), rate)).collect())
}

/// The cheapest sequence of entries of a grid: `table` has what each costs at each step.
fn cheapest(table: &[Vec<f64>], grid: &[DVec3]) -> Vec<usize> {
    let (Some(first), count) = (table.first(), grid.len()) else { return Vec::new() };
    let mut sums = first.clone();
    let mut from: Vec<Vec<usize>> = Vec::new();
    for costs in &table[1..] {
        // With a change that costs the most it does not matter from where.
        let low = (0..count).min_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or(0);
        let best: Vec<(f64, usize)> = (0..count)
            .into_par_iter()
            .map(|to| {
                let mut best = (sums[low] + MOST_CHANGE, low);
                for (at, &sum) in sums.iter().enumerate() {
                    let sum = sum + CHANGE_COSTS * grid[at].distance(grid[to]);
                    if sum < best.0 {
                        best = (sum, at);
                    }
                }
                best
            })
            .collect();
        sums = std::iter::zip(&best, costs).map(|((sum, _), cost)| sum + cost).collect();
        from.push(best.into_iter().map(|(_, at)| at).collect());
    }
    let mut at = (0..count).min_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or(0);
    let mut path = vec![at];
    for from in from.iter().rev() {
        at = from[at];
        path.push(at);
    }
    path.reverse();
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::refine::tests::windows;

    #[test]
    fn a_rate_that_jumps_is_found_on_either_side_and_one_that_does_not_is_one() {
        let (before, after) = (DVec3::new(1.0, 4.0, -2.0), DVec3::new(-6.0, 4.0, 3.0));
        let instants: Vec<(usize, f64)> = (0..5).map(|moment| (moment, 0.1 * moment as f64)).collect();
        let jumping = windows(|moment| if moment < 2 { before } else { after });
        let evidence = Evidence { shades: None, windows: &jumping, instants: instants.clone() };
        let found = varying(&evidence, before).expect("it changes");
        assert_eq!(found.len(), 4);
        assert!((found[0].0 - 0.05).abs() < 1e-12);
        assert!(found[0].1.distance(before) < 1.5, "{found:?}");
        // A velocity that is found besides takes some of it.
        assert!(found[2..].iter().all(|(_, rate)| rate.distance(after) < 0.4 * before.distance(after)), "{found:?}");
        let steady = windows(|_| before);
        assert_eq!(varying(&Evidence { shades: None, windows: &steady, instants: instants.clone() }, before), None);
        // Nothing tells anything, or there is one interval.
        let none = BTreeMap::new();
        assert_eq!(varying(&Evidence { shades: None, windows: &none, instants: instants.clone() }, DVec3::ZERO), None);
        let few = instants[..2].to_vec();
        assert_eq!(varying(&Evidence { shades: None, windows: &jumping, instants: few }, before), None);
    }

    #[test]
    fn a_jump_is_paid_once_and_noise_is_not_followed() {
        let grid = [DVec3::ZERO, DVec3::X * 50.0, DVec3::X];
        let table = [[0.0, 1.0, 0.01], [0.0, 1.0, -0.01], [0.0, 1.0, 0.01], [1.0, 0.0, 1.0], [1.0, 0.0, 1.0]];
        assert_eq!(cheapest(&table.map(|row| row.to_vec()), &grid), [0, 0, 0, 1, 1]);
        assert!(cheapest(&[], &grid).is_empty());
    }
}
