//! Frames of a free-running camera at even intervals: period and phase fitted to stamps, which jitter.
//!
//! A camera whose exposure is locked takes a frame each so many cycles of its crystal, and what a stamp adds to that is USB
//! and interrupts. So lines are laid through many stamps, with the frames counted, apart wherever the rate or the phase
//! changes. Whether the camera is one of these is asked of the stamps: where they lie farther from the line than neighbours
//! jitter against each other, the frames do not come at even intervals (a rate that follows the light), and the stamps are
//! taken as they are.

use std::ops::Range;

use erfgs_session::clock::{Clock, Errors, Evidence, Residuals, Sample};

use super::frames::Arrived;

/// Fewer frames tell no period.
const MIN_FRAMES: usize = 30;
/// So many frames tell where the next ones come.
const NEAR: usize = 15;
/// A frame that was not counted may be missing so many times in a row.
const MAX_UNCOUNTED: i64 = 1000;
/// A frame's interval in ticks of the fit: fine ones, since the fit takes a tick for nothing.
const TICKS: f64 = 1e6;
/// Rates drift with the temperature, and hundreds of frames average their jitter away.
const WINDOW_NS: i64 = 10_000_000_000;
/// How much farther from the line stamps may lie than neighbours jitter, as a factor and nanoseconds.
const UNEVEN: (f64, f64) = (2.0, 20_000.0);

/// The stamps of a stream without their jitter, as far as that can be told.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Even {
    /// When each frame would have been stamped without jitter, session nanoseconds; its stamp where that is not known.
    pub at_ns: Vec<i64>,
    /// How far the stamps lie from there; of frames that come unevenly, how much neighbours jitter.
    pub residuals: Residuals,
    /// Frames whose times are fitted.
    pub fitted: u64,
    /// Stretches of one rate and phase.
    pub stretches: u64,
}

/// Fits period and phase. `counts` are the frames as they were exposed, those counted that were lost.
#[must_use]
pub fn even(frames: &[Arrived], counts: &[u64]) -> Even {
    let stamps: Vec<i64> = frames.iter().map(|frame| frame.stamp_ns).collect();
    let mut found = Even { at_ns: stamps.clone(), ..Even::default() };
    let mut distances = Vec::with_capacity(stamps.len());
    for (range, numbers) in stretches(&stamps, counts) {
        let own = &stamps[range.clone()];
        let jitter = jitter(own, &numbers);
        match fit(own, &numbers) {
            Some(line) if is_even(own, &line, &jitter) => {
                found.fitted += own.len() as u64;
                found.stretches += 1;
                distances.extend(std::iter::zip(own, &line).map(|(stamp, at)| stamp.abs_diff(*at) as f64));
                found.at_ns[range].copy_from_slice(&line);
            }
            _ => distances.extend(jitter),
        }
    }
    found.residuals = Residuals::of(distances);
    found
}

/// Stretches of one rate and phase, with the number of each frame in its stretch.
fn stretches(stamps: &[i64], counts: &[u64]) -> Vec<(Range<usize>, Vec<i64>)> {
    let counted =
        |at: usize| counts.get(at).zip(counts.get(at - 1)).map_or(1, |(to, from)| to.saturating_sub(*from).max(1));
    let mut found = Vec::new();
    let (mut first, mut numbers) = (0, vec![0_i64]);
    for at in 1..stamps.len() {
        let line = Recent::of(&stamps[first..at], &numbers).unwrap_or_else(|| {
            // Too few yet: what comes tells the period.
            let steps = (at..stamps.len().min(at + NEAR))
                .map(|at| stamps[at].saturating_sub(stamps[at - 1]) as f64 / counted(at) as f64);
            Recent::with(median(steps.collect()), &stamps[first..at], &numbers)
        });
        let last = numbers.last().copied().unwrap_or(0);
        let next = last.saturating_add_unsigned(counted(at));
        // A stamp that is late alone is followed by one that is not.
        let late_alone =
            || stamps.get(at + 1).is_some_and(|&after| line.fits(next.saturating_add_unsigned(counted(at + 1)), after));
        let number = if line.fits(next, stamps[at]) || late_alone() {
            Some(next)
        } else {
            Some(line.number(stamps[at])).filter(|&number| {
                (last.saturating_add(1)..=last.saturating_add(MAX_UNCOUNTED)).contains(&number)
                    && line.fits(number, stamps[at])
            })
        };
        match number {
            Some(number) => numbers.push(number),
            None => {
                found.push((first..at, std::mem::replace(&mut numbers, vec![0])));
                first = at;
            }
        }
    }
    if !stamps.is_empty() {
        found.push((first..stamps.len(), numbers));
    }
    found
}

/// A line through the last frames of a stretch.
struct Recent {
    period: f64,
    /// Stamp of number 0, from the stretch's first one.
    phase: f64,
    zero: i64,
}

impl Recent {
    /// `None` for too few frames.
    fn of(stamps: &[i64], numbers: &[i64]) -> Option<Self> {
        if stamps.len() < NEAR {
            return None;
        }
        let recent = stamps.len() - stamps.len().min(2 * NEAR)..stamps.len();
        Some(Self::with(period(&stamps[recent.clone()], &numbers[recent]), stamps, numbers))
    }

    fn with(period: f64, stamps: &[i64], numbers: &[i64]) -> Self {
        let zero = stamps.first().copied().unwrap_or(0);
        let recent = std::iter::zip(stamps, numbers).rev().take(2 * NEAR);
        let phases = recent.map(|(stamp, &number)| stamp.saturating_sub(zero) as f64 - number as f64 * period);
        Self { period: period.max(1.0), phase: median(phases.collect()), zero }
    }

    fn fits(&self, number: i64, stamp: i64) -> bool {
        let at = stamp.saturating_sub(self.zero) as f64 - self.phase;
        (at - number as f64 * self.period).abs() <= self.period / 4.0
    }

    fn number(&self, stamp: i64) -> i64 {
        ((stamp.saturating_sub(self.zero) as f64 - self.phase) / self.period).round() as i64
    }
}

/// The period of frames of these numbers: the median over half of them.
fn period(stamps: &[i64], numbers: &[i64]) -> f64 {
    let half = stamps.len() / 2;
    let slopes = (0..stamps.len() - half).map(|at| {
        let frames = numbers[at + half].saturating_sub(numbers[at]).max(1) as f64;
        stamps[at + half].saturating_sub(stamps[at]) as f64 / frames
    });
    median(slopes.collect())
}

/// When frames of these numbers would be stamped; `None` if they are too few.
fn fit(stamps: &[i64], numbers: &[i64]) -> Option<Vec<i64>> {
    if stamps.len() < MIN_FRAMES {
        return None;
    }
    let ns_per_tick = period(stamps, numbers) / TICKS;
    let ticks = |number: i64| number.saturating_mul(TICKS as i64);
    let samples = std::iter::zip(stamps, numbers).map(|(&session_ns, &n)| Sample { ticks: ticks(n), session_ns });
    let samples: Vec<Sample> = samples.collect();
    let clock = Clock::fit(&samples, ns_per_tick, Evidence::KernelStamps, Errors::Symmetric, WINDOW_NS).ok()?;
    Some(numbers.iter().map(|&number| clock.session_ns(ticks(number))).collect())
}

/// How much each stamp jitters against the two beside it: the second difference, of which a normal jitter is a sqrt(6)th.
fn jitter(stamps: &[i64], numbers: &[i64]) -> Vec<f64> {
    let triples = std::iter::zip(stamps.windows(3), numbers.windows(3));
    let neighbours = triples.filter(|(_, n)| n[1].saturating_sub(n[0]) == 1 && n[2].saturating_sub(n[1]) == 1);
    let second = |t: &[i64]| t[2].saturating_sub(t[1]).saturating_sub(t[1].saturating_sub(t[0]));
    neighbours.map(|(t, _)| (second(t) as f64).abs() / 6_f64.sqrt()).collect()
}

fn is_even(stamps: &[i64], line: &[i64], jitter: &[f64]) -> bool {
    let typical = median(std::iter::zip(stamps, line).map(|(stamp, at)| stamp.abs_diff(*at) as f64).collect());
    typical <= UNEVEN.0 * median(jitter.to_vec()) + UNEVEN.1
}

/// The middle one of values, of two the greater; 0 of nothing.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    fn uniform(n: u64, purpose: u64) -> f64 {
        random::range(random::key(17, &[n, purpose]), 1e-9, 1.0)
    }

    /// Stamps of frames at these times: half a millisecond late in the mean, and one in a hundred by up to 15 ms.
    fn stamped(times: &[i64]) -> Vec<Arrived> {
        let stamp = |(n, at): (usize, &i64)| {
            let n = n as u64;
            let late = if uniform(n, 1) < 0.01 { 15e6 * uniform(n, 2) } else { 0.0 };
            Arrived { sequence: n, stamp_ns: at + (late - 500e3 * uniform(n, 0).ln()) as i64 }
        };
        times.iter().enumerate().map(stamp).collect()
    }

    /// How far times are off but for what is common to all, nanoseconds.
    fn off(found: &[i64], truth: &[i64]) -> Residuals {
        let late: Vec<f64> = std::iter::zip(found, truth).map(|(found, truth)| (found - truth) as f64).collect();
        let common = median(late.clone());
        Residuals::of(late.into_iter().map(|late| (late - common).abs()).collect())
    }

    /// 30 Hz by a crystal that drifts by 1 ppm a minute.
    fn times(frames: i64) -> Vec<i64> {
        (0..frames).map(|n| (n as f64 * 33_366_700.0 * (1.0 + n as f64 * 1e-9 / 3.6)) as i64).collect()
    }

    #[test]
    fn most_of_the_jitter_goes_and_the_residuals_say_how_much_there_was() {
        let truth = times(1800);
        let frames = stamped(&truth);
        let counts: Vec<u64> = (0..1800).collect();
        let found = even(&frames, &counts);
        assert_eq!((found.fitted, found.stretches), (1800, 1));
        let stamps: Vec<i64> = frames.iter().map(|frame| frame.stamp_ns).collect();
        let (before, after) = (off(&stamps, &truth), off(&found.at_ns, &truth));
        println!("p95 {} ns from stamps, {} ns fitted", before.p95_ns, after.p95_ns);
        assert!(before.p95_ns > 1e6 && after.p95_ns < 100e3 && after.max_ns < 150e3, "{before:?} {after:?}");
        assert!((200e3..600e3).contains(&found.residuals.p50_ns), "{:?}", found.residuals);
    }

    #[test]
    fn lost_frames_counted_or_not_leave_the_period_alone() {
        let truth = times(1200);
        let kept: Vec<usize> = (0..1200).filter(|n| n % 37 != 5 && !(400..470).contains(n)).collect();
        let truth: Vec<i64> = kept.iter().map(|&n| truth[n]).collect();
        let frames = stamped(&truth);
        let counted: Vec<u64> = kept.iter().map(|&n| n as u64).collect();
        let uncounted: Vec<u64> = (0..kept.len() as u64).collect();
        for counts in [counted, uncounted] {
            let found = even(&frames, &counts);
            assert_eq!((found.fitted, found.stretches), (truth.len() as u64, 1));
            assert!(off(&found.at_ns, &truth).p95_ns < 100e3, "{:?}", off(&found.at_ns, &truth));
        }
    }

    #[test]
    fn a_new_rate_or_phase_begins_a_new_line() {
        let mut truth = times(400);
        let end = truth[399] + 47_000_000;
        truth.extend((0..400).map(|n| end + n * 40_010_000));
        let again = end + 400 * 40_010_000 + 2_537_000_000;
        truth.extend((0..400).map(|n| again + n * 40_010_000));
        let counts: Vec<u64> = (0..1200).collect();
        let found = even(&stamped(&truth), &counts);
        assert_eq!(found.stretches, 3);
        assert!(found.fitted > 1190, "{found:?}");
        assert!(off(&found.at_ns, &truth).p95_ns < 150e3, "{:?}", off(&found.at_ns, &truth));
    }

    #[test]
    fn a_rate_that_follows_the_light_leaves_the_stamps_as_they_are() {
        let mut at = 0.0;
        let truth: Vec<i64> = (0..900)
            .map(|n| {
                at += 36e6 + 3e6 * (f64::from(n) / 60.0).sin();
                at as i64
            })
            .collect();
        let frames = stamped(&truth);
        let found = even(&frames, &(0..900).collect::<Vec<u64>>());
        assert_eq!(found.fitted, 0);
        assert!(std::iter::zip(&found.at_ns, &frames).all(|(at, frame)| *at == frame.stamp_ns));
        assert!((200e3..800e3).contains(&found.residuals.p50_ns), "{:?}", found.residuals);
    }

    #[test]
    fn exact_stamps_stay_and_few_are_not_fitted() {
        let truth = times(100);
        let frames: Vec<Arrived> =
            (0..).zip(&truth).map(|(sequence, &stamp_ns)| Arrived { sequence, stamp_ns }).collect();
        let counts: Vec<u64> = (0..100).collect();
        let found = even(&frames, &counts);
        assert!(found.residuals.max_ns < 1000.0 && found.fitted == 100, "{:?}", found.residuals);
        assert_eq!(even(&frames[..20], &counts).fitted, 0);
        assert_eq!(even(&[], &[]), Even::default());
        let same = vec![Arrived { sequence: 0, stamp_ns: 5 }; 50];
        assert_eq!(even(&same, &counts).at_ns, vec![5; 50]);
    }
}
