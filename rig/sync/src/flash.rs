//! The lag of a free-running camera from a flash that an event camera sees, too.
//!
//! The event camera dates the changes of a lamp to microseconds. A frame is as bright as the lamp was lit during its
//! exposure. The lag at which the two agree best is that of the camera, to a small part of an exposure if the lamp's
//! changes fall on all phases of it.

use super::frames::Arrived;

/// How far and how finely lags are tried: up to two periods back, a little ahead (stamps may be early).
const STEPS_PER_PERIOD: i64 = 200;
/// A correlation below this is none.
const MIN_CORRELATION: f64 = 0.7;

/// A lag that a flash told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlashLag {
    /// How long after the middle of its exposure a frame is stamped, nanoseconds.
    pub lag_ns: i64,
    /// How well the brightness follows the lamp at this lag: Pearson's correlation.
    pub correlation: f64,
    /// The range of lags over which the correlation is as good but for a hundredth, nanoseconds: the precision.
    pub width_ns: i64,
}

/// When a lamp was lit, from counts of ON and OFF events in bins of `bin_ns` that start at `start_ns`: a bin with far more
/// events than usual of one polarity is a change. Returns the times at which the lamp went on and off again.
#[must_use]
pub fn lit_intervals(on: &[u32], off: &[u32], start_ns: i64, bin_ns: i64) -> Vec<[i64; 2]> {
    let (rises, falls) = (peaks(on), peaks(off));
    let time = |bin: usize| start_ns + bin as i64 * bin_ns + bin_ns / 2;
    let mut intervals = Vec::new();
    let mut falls = falls.into_iter().peekable();
    for (at, &rise) in rises.iter().enumerate() {
        let before = rises.get(at + 1).copied().unwrap_or(usize::MAX);
        while falls.next_if(|&fall| fall <= rise).is_some() {}
        if let Some(fall) = falls.next_if(|&fall| fall < before) {
            intervals.push([time(rise), time(fall)]);
        }
    }
    intervals
}

/// The first bins of runs that stand out from the others.
fn peaks(counts: &[u32]) -> Vec<usize> {
    let mut sorted = counts.to_vec();
    sorted.sort_unstable();
    let quantile = |q: f64| sorted.get(((sorted.len() as f64 * q) as usize).min(sorted.len().saturating_sub(1)));
    let (usual, high) = (quantile(0.5).copied().unwrap_or(0), quantile(1.0).copied().unwrap_or(0));
    // A lamp changes thousands of pixels in a millisecond; noise and motion change tens.
    let limit = usual + (high - usual) / 3;
    let stands_out = |&at: &usize| counts[at] > limit && counts[at] > 4 * usual.max(5);
    (0..counts.len()).filter(stands_out).filter(|&at| at == 0 || !stands_out(&(at - 1))).collect()
}

/// Finds the lag. `brightness` is the mean grey level of each frame, `lit` the intervals in which the lamp was lit, in
/// session time. `None` if the brightness does not follow the lamp, or there are fewer than 8 frames.
#[must_use]
pub fn find_lag(frames: &[Arrived], brightness: &[f64], lit: &[[i64; 2]], exposure_ns: i64) -> Option<FlashLag> {
    let mut steps: Vec<i64> = frames.windows(2).map(|pair| pair[1].stamp_ns - pair[0].stamp_ns).collect();
    if frames.len() < 8 || frames.len() != brightness.len() || lit.is_empty() {
        return None;
    }
    let middle = steps.len() / 2;
    let period = (*steps.select_nth_unstable(middle).1).max(STEPS_PER_PERIOD);
    let step = period / STEPS_PER_PERIOD;
    let at = |lag: i64| {
        let expected: Vec<f64> = frames.iter().map(|frame| lit_share(frame.stamp_ns - lag, exposure_ns, lit)).collect();
        correlation(&expected, brightness)
    };
    let tried: Vec<(i64, f64)> =
        (-STEPS_PER_PERIOD / 4..2 * STEPS_PER_PERIOD).map(|n| (n * step, at(n * step))).collect();
    let &(_, best) = tried.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    if best < MIN_CORRELATION {
        return None;
    }
    // The best lags form a plateau if no change of the lamp falls into an exposure: its middle is the best guess.
    let good: Vec<i64> = tried.iter().filter(|(_, found)| *found >= best - 0.01).map(|(lag, _)| *lag).collect();
    let (first, last) = (*good.first()?, *good.last()?);
    Some(FlashLag { lag_ns: i64::midpoint(first, last), correlation: best, width_ns: last - first + step })
}

/// The share of an exposure around `mid_ns` in which the lamp was lit.
fn lit_share(mid_ns: i64, exposure_ns: i64, lit: &[[i64; 2]]) -> f64 {
    let (from, to) = (mid_ns - exposure_ns / 2, mid_ns + exposure_ns / 2);
    let first = lit.partition_point(|interval| interval[1] <= from);
    let overlap: i64 = lit[first..]
        .iter()
        .take_while(|interval| interval[0] < to)
        .map(|interval| interval[1].min(to) - interval[0].max(from))
        .sum();
    overlap as f64 / (to - from).max(1) as f64
}

/// Pearson's correlation; 0 where one of the two does not vary.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len() as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / count, b.iter().sum::<f64>() / count);
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in std::iter::zip(a, b) {
        aa += (a - mean_a) * (a - mean_a);
        bb += (b - mean_b) * (b - mean_b);
        ab += (a - mean_a) * (b - mean_b);
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}
