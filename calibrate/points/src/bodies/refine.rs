//! A second look at how a thing turns: with its own shape instead of hulls, over longer times, and at a rate that may change.
//!
//! How much more the rate is at an instant, and how much faster the thing goes on its path, is found by one half of the events; a
//! change counts only if the other half is sharper by it, too.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::{
    contrast::{Change, Window, mean_contrast},
    spin::rounded,
    turn::{climb, rates},
};

/// Events move back by at most so much of a turn, radians, and over so long, microseconds.
const MOST_TURN: f64 = 0.35;
const AROUND_US: [f64; 2] = [8_000.0, 24_000.0];
/// A change of velocity of a metre per second must be worth so much of the contrast, and of the rate from one instant to the next of a
/// radian per second so much. The path is right to some decimetres per second, and what faces a camera of a thing that turns goes the
/// same way: without this price events of a ball are sharpest with a velocity that is wrong and half of the rate.
const VELOCITY_COSTS: f64 = 2.0;
const RATE_COSTS: f64 = 0.0003;
/// So much sharper the other half must be for another rate, and for a rate that changes.
const STEADY_IF: f64 = 1.005;
const CHANGING_IF: f64 = 1.06;

/// Events so long before and after an instant are looked at again for a thing that turns at `rate` (radians per second), microseconds.
pub fn around_us(rate: f64, step_s: f64) -> i64 {
    let turning = 1e6 * MOST_TURN / rate.max(1e-3);
    turning.clamp(AROUND_US[0], AROUND_US[1]).min(0.45e6 * step_s) as i64
}

/// What the second look tells.
#[derive(Clone, Debug, Default)]
pub struct Refined {
    /// Rates more than was assumed, by instant; one for all where the rate does not change.
    pub rates: Vec<(usize, DVec3)>,
    /// Whether the rate changes.
    pub changing: bool,
    /// Velocities more than those of the path, by instant, metres per second; none where they do not help.
    pub velocities: Vec<(usize, DVec3)>,
    /// Numbers for reports.
    pub found_by: BTreeMap<String, Value>,
}

/// Both halves of an instant's events, and what its contrast is measured by.
struct Instant {
    moment: usize,
    half: Vec<Window>,
    other: Vec<Window>,
    usual: f64,
    change: Change,
}

impl Instant {
    fn gain(&self, change: Change) -> f64 {
        mean_contrast(&self.half, change) / self.usual
    }

    fn best_velocity(&self) -> DVec3 {
        best_velocity(&self.half, self.usual, self.change)
    }
}

/// The velocity, near that of `start`, that makes windows sharpest with the rate of `start`; `usual` is the contrast that gains are
/// measured by.
pub fn best_velocity(windows: &[Window], usual: f64, start: Change) -> DVec3 {
    let score = |tries: &[DVec3]| -> Vec<f64> {
        let one = |&velocity: &DVec3| {
            mean_contrast(windows, Change { velocity, ..start }) / usual - VELOCITY_COSTS * velocity.length_squared()
        };
        tries.par_iter().map(one).collect()
    };
    climb((score(&[start.velocity])[0], start.velocity), 0.4, 3, score).1
}

/// Looks at windows again, given by instant, in the order of time.
pub fn refine<'a>(windows: impl IntoIterator<Item = (&'a usize, &'a Vec<Window>)>) -> Refined {
    let instant = |(&moment, windows): (&usize, &Vec<Window>)| {
        let (half, other): (Vec<Window>, Vec<Window>) =
            windows.iter().map(Window::halves).map(|[half, other]| (half, other)).unzip();
        let change = Change::default();
        let usual = mean_contrast(&half, change);
        (usual > 0.0).then_some(Instant { moment, half, other, usual, change })
    };
    let mut instants: Vec<Instant> = windows.into_iter().filter_map(instant).collect();
    let mut refined = Refined::default();
    if instants.is_empty() {
        return refined;
    }
    // Velocities and the common rate by turns.
    for _ in 0..2 {
        for instant in &mut instants {
            instant.change.velocity = instant.best_velocity();
        }
        let common = |tries: &[DVec3]| -> Vec<f64> {
            let one = |&rate: &DVec3| {
                instants.iter().map(|instant| instant.gain(Change { rate, ..instant.change })).sum::<f64>()
            };
            tries.iter().map(one).collect()
        };
        let rate = instants[0].change.rate;
        let rate = climb((common(&[rate])[0], rate), 2.0, 4, common).1;
        for instant in &mut instants {
            instant.change.rate = rate;
        }
    }
    let others = |of: &dyn Fn(&Instant) -> Change| {
        let before = |instant: &Instant| mean_contrast(&instant.other, Change::default()).max(f64::MIN_POSITIVE);
        let gains = instants.iter().map(|instant| mean_contrast(&instant.other, of(instant)) / before(instant));
        gains.sum::<f64>() / instants.len() as f64
    };
    // What the other half says: of nothing changed, of velocities alone, of the common rate alone, and of both.
    let none = others(&|_| Change::default());
    let velocities = others(&|instant| Change { rate: DVec3::ZERO, ..instant.change });
    let rate = others(&|instant| Change { velocity: DVec3::ZERO, ..instant.change });
    let both = others(&|instant| instant.change);
    let keep_velocities = both.max(velocities) > none.max(rate);
    let keep_rate = both.max(rate) > STEADY_IF * none.max(velocities);
    for instant in &mut instants {
        if !keep_velocities {
            instant.change.velocity = DVec3::ZERO;
        }
        if !keep_rate {
            instant.change.rate = DVec3::ZERO;
        }
    }
    let steady: Vec<Change> = instants.iter().map(|instant| instant.change).collect();
    // A rate of its own at each instant, near to those before and after.
    let around = rates(20, &[1.5, 3.0, 6.0]);
    for _ in 0..3 {
        for index in 0..instants.len() {
            let beside: Vec<DVec3> = [index.checked_sub(1), Some(index + 1)]
                .into_iter()
                .flatten()
                .filter_map(|at| Some(instants.get(at)?.change.rate))
                .collect();
            let instant = &instants[index];
            let score = |tries: &[DVec3]| -> Vec<f64> {
                let one = |&rate: &DVec3| {
                    let bend: f64 = beside.iter().map(|other| other.distance_squared(rate)).sum();
                    instant.gain(Change { rate, ..instant.change }) - RATE_COSTS * bend
                };
                tries.iter().map(one).collect()
            };
            // From the best of what is around, since there are tops of less height between.
            let tries: Vec<DVec3> =
                around.iter().map(|more| instant.change.rate + *more).chain(beside.clone()).collect();
            let mut start = (f64::NEG_INFINITY, instant.change.rate);
            for (score, rate) in std::iter::zip(score(&tries), tries) {
                if score > start.0 {
                    start = (score, rate);
                }
            }
            instants[index].change.rate = climb(start, 1.0, 3, score).1;
            if keep_velocities {
                let instant = &mut instants[index];
                instant.change.velocity = instant.best_velocity();
            }
        }
    }
    let sharper = |of: &dyn Fn(usize) -> Change| {
        instants.iter().enumerate().map(|(index, instant)| mean_contrast(&instant.other, of(index))).sum::<f64>()
    };
    let gain = sharper(&|index| instants[index].change) / sharper(&|index| steady[index]).max(f64::MIN_POSITIVE);
    refined.changing = instants.len() > 1 && gain > CHANGING_IF;
    if !refined.changing {
        for (instant, change) in std::iter::zip(&mut instants, &steady) {
            instant.change = *change;
        }
    }
    let kept = if refined.changing { instants.len() } else { 1 };
    refined.rates = instants.iter().take(kept).map(|instant| (instant.moment, instant.change.rate)).collect();
    if keep_velocities {
        refined.velocities = instants.iter().map(|instant| (instant.moment, instant.change.velocity)).collect();
    }
    refined.found_by = BTreeMap::from([
        ("contrast_gained_by_rate".into(), json!(rounded(rate, 4))),
        ("contrast_gained_by_velocities".into(), json!(rounded(velocities, 4))),
        ("contrast_gained_by_both".into(), json!(rounded(both, 4))),
        ("contrast_gained_by_changing_rate".into(), json!(rounded(gain, 4))),
        ("rate_changes".into(), json!(refined.changing)),
    ]);
    refined
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::bodies::{contrast::NetEvent, film::test_eye, turn::directions};
    use erfgs_base::random;
    use glam::DQuat;

    /// What three cameras see around each of five instants of a ball with spots, if it is assumed not to turn.
    pub fn windows(rate: impl Fn(usize) -> DVec3) -> BTreeMap<usize, Vec<Window>> {
        let eyes = [DVec3::new(0.0, -0.5, -2.0), DVec3::new(1.8, -0.8, -0.8), DVec3::new(-1.5, -1.0, 1.3)]
            .map(|from| test_eye(from, DVec3::ZERO));
        let of = |moment: usize, eye: usize| {
            let mut events = Vec::new();
            for (spot, along) in directions(50).into_iter().enumerate() {
                let place = 0.3 * along;
                if (eyes[eye].centre - place).dot(place) < 0.0 {
                    continue;
                }
                for tick in 0..24 {
                    let seconds = 2e-3 * (f64::from(tick) - 11.5);
                    let then = DQuat::from_scaled_axis(rate(moment) * seconds) * place;
                    let Some((pixel, _)) = eyes[eye].see(then) else { continue };
                    let value = if spot % 2 == 0 { 1.0 } else { -1.0 };
                    events.push(NetEvent { pixel: pixel.floor() + 0.5, seconds, value, then: place, place });
                }
            }
            let key = random::key(3, &[moment as u64, eye as u64]);
            let order = random::permutation(key, events.len());
            let events: Vec<NetEvent> = order.into_iter().map(|index| events[index]).collect();
            Window::new(&eyes[eye], &events, DVec3::ZERO, 1.5)
        };
        (0..5).map(|moment| (moment, (0..3).filter_map(|eye| of(moment, eye)).collect())).collect()
    }

    #[test]
    fn a_steady_rate_is_one_and_a_rate_that_changes_is_followed() {
        let truth = DVec3::new(1.0, 4.0, -2.0);
        let steady = refine(&windows(|_| truth));
        assert!(!steady.changing && steady.rates.len() == 1, "{steady:?}");
        assert!(steady.rates[0].1.distance(truth) < 0.7, "{steady:?}");
        let change = |moment: usize| truth * (0.4 * moment as f64);
        let changing = refine(&windows(change));
        assert!(changing.changing, "{changing:?}");
        for (moment, rate) in changing.rates {
            assert!(rate.distance(change(moment)) < 1.5, "{rate} at {moment}");
        }
        assert!(refine(&BTreeMap::new()).rates.is_empty());
    }
}
