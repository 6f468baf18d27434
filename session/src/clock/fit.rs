//! One fitted line from ticks to session time.

use serde::{Deserialize, Serialize};

/// What a fit rests on, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Evidence {
    /// Edges at a trigger input of the device, matched by index with the pulses of the trigger board.
    TriggerEdges,
    /// A flash that several sensors saw.
    Flash,
    /// When data arrived at the host: the delay has a lower bound, which the fit follows.
    Arrival,
    /// The kernel's time stamps, which are on the host's clock already.
    KernelStamps,
}

/// How far the samples lie from a fit, nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Residuals {
    /// Half of the samples lie closer.
    pub p50_ns: f64,
    /// 95 of 100 samples lie closer.
    pub p95_ns: f64,
    /// The farthest sample that the fit did not set aside as an outlier.
    pub max_ns: f64,
}

impl Residuals {
    /// Quantiles of distances; zero for none.
    #[must_use]
    pub fn of(mut distances_ns: Vec<f64>) -> Self {
        distances_ns.sort_unstable_by(f64::total_cmp);
        let quantile = |q: f64| match distances_ns.len() {
            0 => 0.0,
            n => distances_ns[((q * n as f64).ceil() as usize).clamp(1, n) - 1],
        };
        Self { p50_ns: quantile(0.5), p95_ns: quantile(0.95), max_ns: quantile(1.0) }
    }
}

/// A line from device ticks to session time, and how good it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClockFit {
    /// What the fit rests on.
    pub evidence: Evidence,
    /// The tick through which the line goes.
    pub origin_ticks: i64,
    /// The session time of that tick, nanoseconds.
    pub origin_ns: i64,
    /// Nanoseconds of session time for each tick.
    pub ns_per_tick: f64,
    /// The first and the last tick that the samples cover. Beyond them the line is an extrapolation.
    pub window_ticks: [i64; 2],
    /// Distances of the samples from the line.
    pub residuals: Residuals,
    /// How many samples it rests on.
    pub samples: u64,
    /// How many samples were set aside as outliers.
    pub outliers: u64,
}

impl ClockFit {
    /// The session time of a tick, nanoseconds.
    #[must_use]
    pub fn session_ns(&self, ticks: i64) -> i64 {
        let since = (i128::from(ticks) - i128::from(self.origin_ticks)) as f64;
        self.origin_ns.saturating_add((since * self.ns_per_tick).round() as i64)
    }

    /// The tick at a session time.
    #[must_use]
    pub fn ticks(&self, session_ns: i64) -> i64 {
        let since = (i128::from(session_ns) - i128::from(self.origin_ns)) as f64;
        self.origin_ticks.saturating_add((since / self.ns_per_tick).round() as i64)
    }

    /// By how much the device's clock is slower than its ticks should be, parts per million.
    #[must_use]
    pub fn rate_error_ppm(&self, nominal_ns_per_tick: f64) -> f64 {
        (self.ns_per_tick / nominal_ns_per_tick - 1.0) * 1e6
    }
}

/// The same moment on two clocks, as far as it was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Device time, ticks.
    pub ticks: i64,
    /// Session time, nanoseconds.
    pub session_ns: i64,
}

/// Why there is no fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FitError {
    /// There is nothing to fit.
    #[error(
        "no samples to fit a clock to; check that the stream delivered data, and trigger edges if there is a board"
    )]
    NoSamples,
}
