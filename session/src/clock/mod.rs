//! Clocks of devices, and the lines that take their ticks to the session clock.
//!
//! A device counts ticks of its own: microseconds in an event camera, 62.5 ns in the trigger board. They stay as
//! recorded. A [`ClockFit`] says what they mean: nanoseconds on the session clock, which is the host's monotonic clock
//! with its zero where the recording started.

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
