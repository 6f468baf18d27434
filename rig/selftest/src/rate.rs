//! The rate of a device's clock against the host's, from a second or two of arrivals, and how well it is known.
//!
//! Data arrives late and never early, by a delay of which the least is always about the same. So the recording is cut into
//! windows, and of each the least delay counts: a line through these has the clock's rate. What they scatter about the line
//! says how well it is known. The fits of `erfgs-sync` are better lines, but they take it for granted that a device has a
//! crystal (1000 ppm at most), which is to be found out here, and they tell no uncertainty.

use erfgs_session::clock::Sample;
use erfgs_sync::median;

/// Windows that the recording is cut into, and the fewest that tell anything.
const WINDOWS: usize = 16;
const FEWEST: usize = 6;
/// Parts that are left out in turn.
const PARTS: usize = 4;
/// Arrivals that each window has on average, where there are few.
const EACH: usize = 3;
/// A device's clock and the host's are read to about this, nanoseconds: what the scatter is at least.
const FLOOR_NS: f64 = 20_000.0;
/// So many standard deviations are stated. Few windows tell little of their own scatter: of `n` degrees of freedom so many times
/// more, divided by `n`, about as Student's distribution has it.
const SIGMAS: f64 = 4.0;
const FEW: f64 = 9.0;
/// Least delays before and after a jump differ by this at least, nanoseconds, and by so many times their scatter.
const STEP_NS: f64 = 10e6;
const STEP_SCATTERS: f64 = 8.0;
/// Four in five distances of a normal distribution are less than so many standard deviations.
const FOUR_IN_FIVE: f64 = 1.2816;

/// How fast a clock runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// How much faster than it should, parts per million.
    pub ppm: f64,
    /// The truth is farther off by chance alone in one of ten thousand recordings, parts per million.
    pub uncertainty_ppm: f64,
}

/// What arrivals say of a clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RateFit {
    /// It runs evenly.
    Even(Rate),
    /// It jumped by so much, nanoseconds; positive: ahead.
    Stepped {
        /// How far.
        by_ns: f64,
    },
    /// There are too few arrivals.
    TooFew,
}

/// The least delay within a window.
#[derive(Clone, Copy, Debug)]
struct Least {
    at_ns: f64,
    delay_ns: f64,
}

impl RateFit {
    /// Of samples of a clock whose ticks should be `ns_per_tick` long, in the order of their arrival.
    #[must_use]
    pub fn of(samples: &[Sample], ns_per_tick: f64) -> Self {
        let least = least_delays(samples, ns_per_tick);
        if least.len() < FEWEST {
            return Self::TooFew;
        }
        let line = Line::through(&least);
        let from_line = scatter(least.iter().map(|point| line.distance(point)));
        if let Some(by_ns) = step(&least, from_line) {
            return Self::Stepped { by_ns };
        }
        let span_ns = least.last().map_or(0.0, |last| last.at_ns) - least[0].at_ns;
        if span_ns <= 0.0 {
            return Self::TooFew;
        }
        // The standard deviation of the slope of a line through evenly spaced points, and that by leaving out each part of the
        // recording in turn: a host that is busy for a while is late in many windows alike.
        let by_scatter = from_line.max(FLOOR_NS) * (12.0 / least.len() as f64).sqrt() / span_ns;
        let slope_sigma = by_scatter.max(by_parts(&least));
        // A clock that is fast comes to be ahead of the host's, so that data seems less late.
        let sigmas = SIGMAS * (1.0 + FEW / (least.len() - 2) as f64);
        Self::Even(Rate { ppm: -1e6 * line.slope, uncertainty_ppm: 1e6 * sigmas * slope_sigma })
    }
}

/// The arrivals of each window that are least late, by host time.
fn least_delays(samples: &[Sample], ns_per_tick: f64) -> Vec<Least> {
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return Vec::new() };
    let since_ns = |ns: i64, origin: i64| (i128::from(ns) - i128::from(origin)) as f64;
    let span_ns = since_ns(last.session_ns, first.session_ns);
    if span_ns <= 0.0 {
        return Vec::new();
    }
    let windows = WINDOWS.min(samples.len() / EACH);
    let mut least: Vec<Option<Least>> = vec![None; windows];
    for sample in samples {
        let at_ns = since_ns(sample.session_ns, first.session_ns);
        let delay_ns = at_ns - ns_per_tick * since_ns(sample.ticks, first.ticks);
        let window = (at_ns / span_ns * windows as f64).clamp(0.0, windows.saturating_sub(1) as f64) as usize;
        if let Some(place) = least.get_mut(window)
            && place.is_none_or(|before| delay_ns < before.delay_ns)
        {
            *place = Some(Least { at_ns, delay_ns });
        }
    }
    least.into_iter().flatten().collect()
}

struct Line {
    slope: f64,
    offset: f64,
}

impl Line {
    /// The median of the slopes of all pairs (Theil and Sen): three in ten windows may be wrong.
    fn through(points: &[Least]) -> Self {
        let pairs = points.iter().enumerate().flat_map(|(index, a)| points[..index].iter().map(move |b| (a, b)));
        let slope = median(pairs.map(|(a, b)| (a.delay_ns - b.delay_ns) / (a.at_ns - b.at_ns).max(1.0)).collect());
        Self { slope, offset: median(points.iter().map(|point| point.delay_ns - slope * point.at_ns).collect()) }
    }

    fn distance(&self, point: &Least) -> f64 {
        point.delay_ns - self.offset - self.slope * point.at_ns
    }
}

/// The standard deviation of the slope, by the lines through all parts but one (the jackknife).
fn by_parts(least: &[Least]) -> f64 {
    let length = least.len().div_ceil(PARTS);
    let without = |part: usize| {
        let rest = least.iter().enumerate().filter(|(index, _)| index / length != part).map(|(_, point)| *point);
        Line::through(&rest.collect::<Vec<_>>()).slope
    };
    let slopes: Vec<f64> = (0..PARTS).map(without).collect();
    let mean = slopes.iter().sum::<f64>() / PARTS as f64;
    let squares: f64 = slopes.iter().map(|slope| (slope - mean).powi(2)).sum();
    (squares * (PARTS - 1) as f64 / PARTS as f64).sqrt()
}

/// A jump between two levels that explains the delays better than a line, whose scatter is `from_line`.
fn step(least: &[Least], from_line: f64) -> Option<f64> {
    let levels = |place: usize| {
        let (before, after) = least.split_at(place);
        let level = |side: &[Least]| median(side.iter().map(|point| point.delay_ns).collect());
        let (low, high) = (level(before), level(after));
        let off =
            before.iter().map(|point| point.delay_ns - low).chain(after.iter().map(|point| point.delay_ns - high));
        (scatter(off), high - low)
    };
    let (from_levels, by_ns) = (2..least.len().saturating_sub(1)).map(levels).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let is_step = by_ns.abs() > STEP_NS.max(STEP_SCATTERS * from_levels.max(FLOOR_NS)) && 2.0 * from_levels < from_line;
    is_step.then_some(-by_ns)
}

/// The standard deviation of distances, but for the fifth of them that is farthest.
fn scatter(distances: impl Iterator<Item = f64>) -> f64 {
    let mut distances: Vec<f64> = distances.map(f64::abs).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let place = (0.8 * distances.len() as f64) as usize;
    distances.get(place.min(distances.len().saturating_sub(1))).map_or(0.0, |distance| distance / FOUR_IN_FIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Arrivals every millisecond of a clock of microseconds that gains `ppm`, each late by what `delay_us` says.
    fn arrivals(milliseconds: i64, ppm: f64, delay_us: impl Fn(i64) -> i64) -> Vec<Sample> {
        let at = |ms: i64| {
            let ticks = 7_000_000 + (ms as f64 * 1e3 * (1.0 + ppm * 1e-6)) as i64;
            Sample { ticks, session_ns: 500_000_000 + ms * 1_000_000 + 1000 * delay_us(ms) }
        };
        (0..milliseconds).map(at).collect()
    }

    fn rate(samples: &[Sample]) -> Rate {
        match RateFit::of(samples, 1000.0) {
            RateFit::Even(rate) => rate,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_truth_lies_within_what_is_stated() {
        for ppm in [0.0, 40.0, -100.0, 900.0, -5000.0, 300_000.0] {
            for delay in
                [|_| 200, |ms: i64| 100 * (ms * 7919 % 13), |ms| if ms % 90 < 80 { 4000 } else { 30 * (ms % 7) }]
            {
                let found = rate(&arrivals(2000, ppm, delay));
                assert!((found.ppm - ppm).abs() <= found.uncertainty_ppm, "{ppm}: {found:?}");
                assert!(found.uncertainty_ppm < 3000.0 + 0.05 * ppm.abs(), "{ppm}: {found:?}");
            }
        }
    }

    #[test]
    fn a_host_that_was_busy_for_a_while_is_not_a_clock_that_is_off() {
        // For 400 of 2000 ms nothing was read in time.
        let busy = |ms: i64| if (700..1100).contains(&ms) { 1000 * (1100 - ms) } else { 100 * (ms % 9) };
        let found = rate(&arrivals(2000, 25.0, busy));
        assert!((found.ppm - 25.0).abs() <= found.uncertainty_ppm && found.uncertainty_ppm < 1000.0, "{found:?}");
    }

    #[test]
    fn a_jump_is_no_rate() {
        for by_us in [50_000_i64, -30_000] {
            let mut samples = arrivals(2000, 20.0, |ms| 100 * (ms % 9));
            samples.iter_mut().skip(900).for_each(|sample| sample.ticks += by_us);
            let RateFit::Stepped { by_ns } = RateFit::of(&samples, 1000.0) else { panic!("{by_us}") };
            assert!((by_ns / 1e3 - by_us as f64).abs() < 1000.0, "{by_us}: {by_ns}");
        }
    }

    #[test]
    fn of_too_few_arrivals_nothing_is_claimed() {
        assert_eq!(RateFit::of(&[], 1.0), RateFit::TooFew);
        assert_eq!(RateFit::of(&arrivals(10, 0.0, |_| 0), 1000.0), RateFit::TooFew);
        let same = vec![Sample { ticks: 5, session_ns: 5 }; 100];
        assert_eq!(RateFit::of(&same, 1000.0), RateFit::TooFew);
        let absurd = [i64::MIN, i64::MAX].map(|far| Sample { ticks: -far.max(-i64::MAX), session_ns: far });
        assert_eq!(RateFit::of(&absurd, 1000.0), RateFit::TooFew);
    }
}
