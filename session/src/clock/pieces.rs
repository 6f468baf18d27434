//! A clock whose rate drifts, as a chain of lines.
//!
//! The samples are cut into windows and a line is fitted to each. Where a line is best known, at the mean of its window,
//! lies a knot; between the knots the clock is straight, so that it is continuous, and beyond the first and last knot
//! it goes on with the line of that window.

use serde::{Deserialize, Serialize};

use super::fit::{ClockFit, Evidence, FitError, Residuals, Sample};
use super::line::{Robust, fit_line, fit_lower_envelope};

/// The chain is kept if it takes the mean distance of the samples below this share of what one line leaves.
const WORTH: f64 = 0.9;
/// Windows with fewer samples say too little on a rate.
const MIN_SAMPLES: usize = 30;

/// From ticks to session time: one line, or a chain of lines where the rate drifts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// What a tick should be, nanoseconds.
    pub nominal_ns_per_tick: f64,
    /// The lines, in order of time. Each holds from its first to its last tick; the first and the last also beyond.
    pub pieces: Vec<ClockFit>,
    /// Distances of all samples from the clock.
    pub residuals: Residuals,
    /// How many samples it rests on.
    pub samples: u64,
    /// How many samples were set aside as outliers.
    pub outliers: u64,
}

/// How the errors of samples are distributed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Errors {
    /// Either sign: matched edges.
    Symmetric,
    /// Late, never early: arrivals.
    Late,
}

impl Clock {
    /// A clock of one line.
    #[must_use]
    pub fn line(fit: ClockFit, nominal_ns_per_tick: f64) -> Self {
        let (residuals, samples, outliers) = (fit.residuals, fit.samples, fit.outliers);
        Self { nominal_ns_per_tick, pieces: vec![fit], residuals, samples, outliers }
    }

    /// Fits one line, and a chain of lines over windows of `window_ns`; takes the chain if it is clearly better.
    ///
    /// # Errors
    /// Without samples.
    pub fn fit(
        samples: &[Sample],
        nominal_ns_per_tick: f64,
        evidence: Evidence,
        errors: Errors,
        window_ns: i64,
    ) -> Result<Self, FitError> {
        Self::fit_with(samples, nominal_ns_per_tick, evidence, errors, window_ns, &Robust::default())
    }

    /// As [`Clock::fit`], with another way to keep outliers out.
    ///
    /// # Errors
    /// Without samples.
    pub fn fit_with(
        samples: &[Sample],
        nominal_ns_per_tick: f64,
        evidence: Evidence,
        errors: Errors,
        window_ns: i64,
        robust: &Robust,
    ) -> Result<Self, FitError> {
        let fit = |samples: &[Sample]| match errors {
            Errors::Symmetric => fit_line(samples, nominal_ns_per_tick, evidence, robust),
            Errors::Late => fit_lower_envelope(samples, nominal_ns_per_tick, evidence, robust),
        };
        let line = Self::line(fit(samples)?, nominal_ns_per_tick);
        let Some(mut chain) = Self::chain(samples, nominal_ns_per_tick, window_ns, fit) else { return Ok(line) };
        // Outliers are those of the windows: a drifting clock makes outliers of good samples for a single line.
        let limit = chain.residuals.max_ns;
        let mean = |clock: &Self| {
            let kept =
                samples.iter().map(|sample| clock.distance_ns(sample).abs()).filter(|&distance| distance <= limit);
            let (sum, count) = kept.fold((0.0, 0.0), |(sum, count), distance| (sum + distance, count + 1.0));
            (sum / f64::max(count, 1.0), count)
        };
        let ((with_line, in_line), (with_chain, in_chain)) = (mean(&line), mean(&chain));
        let better = in_chain > in_line * (2.0 - WORTH) || with_chain < WORTH * with_line;
        if !better {
            return Ok(line);
        }
        chain.residuals = Residuals::of(
            samples
                .iter()
                .map(|sample| chain.distance_ns(sample).abs())
                .filter(|&distance| distance <= limit)
                .collect(),
        );
        Ok(chain)
    }

    fn chain(
        samples: &[Sample],
        nominal_ns_per_tick: f64,
        window_ns: i64,
        fit: impl Fn(&[Sample]) -> Result<ClockFit, FitError>,
    ) -> Option<Self> {
        let mut sorted = samples.to_vec();
        sorted.sort_unstable_by_key(|sample| sample.ticks);
        let (first, last) = (sorted.first()?.ticks, sorted.last()?.ticks);
        let ticks = (i128::from(last) - i128::from(first)) as f64;
        let count = (ticks * nominal_ns_per_tick / window_ns.max(1) as f64).floor();
        let count = count.min((samples.len() / MIN_SAMPLES) as f64) as usize;
        if count < 2 {
            return None;
        }
        let mut lines: Vec<ClockFit> = Vec::new();
        let mut rest = &sorted[..];
        for window in 1..=count {
            let end = first.saturating_add((ticks * window as f64 / count as f64) as i64);
            let (inside, after) = rest.split_at(rest.partition_point(|sample| sample.ticks <= end));
            rest = after;
            if inside.len() >= MIN_SAMPLES {
                lines.push(fit(inside).ok()?);
            }
        }
        if lines.len() < 2 {
            return None;
        }
        let mut pieces = Vec::with_capacity(lines.len() + 1);
        let knot = |line: &ClockFit| {
            let middle = i128::midpoint(line.window_ticks[0].into(), line.window_ticks[1].into()) as i64;
            (middle, line.session_ns(middle))
        };
        let piece = |line: &ClockFit, from: (i64, i64), to: i64, ns_per_tick: f64| ClockFit {
            origin_ticks: from.0,
            origin_ns: from.1,
            ns_per_tick,
            window_ticks: [from.0.min(to), from.0.max(to)],
            ..line.clone()
        };
        let (start, end) = (&lines[0], &lines[lines.len() - 1]);
        pieces.push(piece(start, knot(start), start.window_ticks[0], start.ns_per_tick));
        for pair in lines.windows(2) {
            let (from, to) = (knot(&pair[0]), knot(&pair[1]));
            let slope = (to.1 - from.1) as f64 / (to.0 - from.0) as f64;
            pieces.push(piece(&pair[0], from, to.0, slope));
        }
        pieces.push(piece(end, knot(end), end.window_ticks[1], end.ns_per_tick));
        let worst = lines.iter().map(|line| line.residuals.max_ns).fold(0.0, f64::max);
        Some(Self {
            nominal_ns_per_tick,
            pieces,
            residuals: Residuals { max_ns: worst, ..Residuals::default() },
            samples: lines.iter().map(|line| line.samples).sum(),
            outliers: lines.iter().map(|line| line.outliers).sum(),
        })
    }

    /// What the clock rests on.
    #[must_use]
    pub fn evidence(&self) -> Option<Evidence> {
        self.pieces.first().map(|piece| piece.evidence)
    }

    /// The share of samples that were set aside as outliers, 0 to 1.
    #[must_use]
    pub fn outlier_share(&self) -> f64 {
        self.outliers as f64 / self.samples.saturating_add(self.outliers).max(1) as f64
    }

    /// The session time of a tick, nanoseconds; 0 for a clock without lines.
    #[must_use]
    pub fn session_ns(&self, ticks: i64) -> i64 {
        let at = self.pieces.partition_point(|piece| piece.window_ticks[1] < ticks);
        self.pieces.get(at).or(self.pieces.last()).map_or(0, |piece| piece.session_ns(ticks))
    }

    /// Mean rate error over all pieces, parts per million: by how much the device's clock is slower than it should be.
    #[must_use]
    pub fn rate_error_ppm(&self) -> f64 {
        let [Some(first), Some(last)] = [self.pieces.first(), self.pieces.last()] else { return 0.0 };
        let ([from, _], [_, to]) = (first.window_ticks, last.window_ticks);
        if to <= from {
            return first.rate_error_ppm(self.nominal_ns_per_tick);
        }
        let ns = (i128::from(self.session_ns(to)) - i128::from(self.session_ns(from))) as f64;
        let ticks = (i128::from(to) - i128::from(from)) as f64;
        (ns / ticks / self.nominal_ns_per_tick - 1.0) * 1e6
    }

    /// How much later than the clock says a sample is, nanoseconds.
    #[must_use]
    pub fn distance_ns(&self, sample: &Sample) -> f64 {
        (i128::from(sample.session_ns) - i128::from(self.session_ns(sample.ticks))) as f64
    }
}
