//! How a thing turns that bounces: each stretch between bounces by itself, since a bounce changes the rate.

use glam::DVec3;

use super::{
    contrast::Window,
    draft::best_seen_s,
    film::Film,
    globe::Globes,
    near_events::Windows,
    shades::Shades,
    spin::{self, Spin},
    things::Thing,
};

/// Events of an instant that is nearer to a bounce, seconds, are partly from before and partly from after it.
const CLEAR_S: f64 = 0.010;
/// A stretch must have so many instants with events to be looked at by itself.
const FEWEST: usize = 2;
/// Rates hold up to so near to a bounce, seconds.
const NEAR_S: f64 = 1e-4;

/// The time between two bounces of a thing, or before the first, or after the last, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    from_s: f64,
    to_s: f64,
}

impl Stretch {
    /// All stretches between bounces at times, in order.
    pub fn all(bounces_s: impl IntoIterator<Item = f64>) -> Vec<Self> {
        let mut from_s = f64::NEG_INFINITY;
        let ends = bounces_s.into_iter().chain([f64::INFINITY]);
        ends.map(|to_s| Self { from_s: std::mem::replace(&mut from_s, to_s), to_s }).collect()
    }

    /// Whether a time is in it, and not near to a bounce.
    fn clearly_has(&self, t_s: f64) -> bool {
        t_s > self.from_s + CLEAR_S && t_s < self.to_s - CLEAR_S
    }

    /// Whether a time is in it.
    pub fn has(&self, t_s: f64) -> bool {
        t_s >= self.from_s && t_s < self.to_s
    }

    /// The events of its instants.
    pub fn windows<'a>(self, film: &Film, windows: &'a Windows) -> impl Iterator<Item = (&'a usize, &'a Vec<Window>)> {
        windows.iter().filter(move |(moment, _)| self.clearly_has(film.moments[**moment].t_s))
    }

    /// Rates at times of stretches that each have their own, in a recording of so many seconds.
    fn rates(stretches: &[Self], rates: &[DVec3], seconds: f64) -> Vec<(f64, DVec3)> {
        let ends = |stretch: &Self| [stretch.from_s.max(0.0) + NEAR_S, stretch.to_s.min(seconds) - NEAR_S];
        let all = std::iter::zip(stretches, rates);
        let mut at: Vec<(f64, DVec3)> = all.flat_map(|(stretch, &rate)| ends(stretch).map(|t_s| (t_s, rate))).collect();
        // Of a bounce at the very beginning or end nothing is left on one side.
        at.sort_by(|a, b| a.0.total_cmp(&b.0));
        at.dedup_by_key(|rate| rate.0);
        at
    }
}

/// How a thing turns that bounces: as is told for the stretch in which it is seen best, and the rates of all. None of what does not bounce.
pub fn turning(film: &Film, thing: &Thing, windows: &Windows, step_s: f64) -> Option<(Spin, Vec<(f64, DVec3)>)> {
    let stretches = Stretch::all(thing.path.bounces_s());
    if stretches.len() < 2 {
        return None;
    }
    let mut spins = spins(film, thing, &stretches, windows, step_s);
    let rates: Vec<DVec3> = spins.iter().map(|spin| spin.rate).collect();
    let best_s = best_seen_s(film, thing)?;
    let best = stretches.iter().position(|stretch| stretch.has(best_s))?;
    Some((spins.swap_remove(best), Stretch::rates(&stretches, &rates, film.seconds())))
}

/// How it turns in each of its stretches, by itself.
fn spins(film: &Film, thing: &Thing, stretches: &[Stretch], windows: &Windows, step_s: f64) -> Vec<Spin> {
    let spin = |stretch: &Stretch| {
        let time = |moment: usize| film.moments[moment].t_s;
        let from = thing.shapes.partition_point(|shape| time(shape.moment) <= stretch.from_s + CLEAR_S);
        let to = thing.shapes.partition_point(|shape| time(shape.moment) < stretch.to_s - CLEAR_S);
        let own: Vec<&Vec<Window>> = stretch.windows(film, windows).map(|(_, windows)| windows).collect();
        if own.len() < FEWEST || to.saturating_sub(from) < FEWEST {
            return None;
        }
        let shades = thing.slim.get(from..to).and_then(|shapes| Shades::new(film, shapes));
        let globes = Globes::longer_and_longer(thing.globes.get(from..to).unwrap_or_default());
        let all: Vec<&Window> = own.into_iter().flatten().collect();
        Some(spin::spin(&Globes::with(&globes, shades.as_ref()), &all, step_s))
    };
    let spins: Vec<Option<Spin>> = stretches.iter().map(spin).collect();
    // A stretch that tells nothing turns as the nearest that does.
    let nearest = |index: usize| {
        let known = spins.iter().enumerate().filter_map(|(at, spin)| spin.as_ref().map(|spin| (at, spin)));
        known.min_by_key(|(at, _)| at.abs_diff(index)).map(|(_, spin)| spin.clone()).unwrap_or_default()
    };
    (0..stretches.len()).map(nearest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_lie_between_bounces() {
        let all = Stretch::all([0.2, 0.5]);
        assert_eq!(all.len(), 3);
        assert!(all[0].has(-1.0) && all[1].has(0.2) && all[2].has(9.0) && !all[1].has(0.5));
        assert!(!all[1].clearly_has(0.205) && all[1].clearly_has(0.3) && !all[1].clearly_has(0.495));
        let rates = Stretch::rates(&all, &[DVec3::X, DVec3::Y, DVec3::Z], 1.0);
        let times: Vec<i64> = rates.iter().map(|rate| (1e4 * rate.0).round() as i64).collect();
        assert_eq!(times, [1, 1999, 2001, 4999, 5001, 9999]);
        assert_eq!([rates[1].1, rates[2].1, rates[3].1], [DVec3::X, DVec3::Y, DVec3::Y]);
        assert_eq!(Stretch::all([]), [Stretch { from_s: f64::NEG_INFINITY, to_s: f64::INFINITY }]);
    }
}
