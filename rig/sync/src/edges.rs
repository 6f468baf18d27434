//! The pulses as an event camera saw them at its trigger input, matched with the board's by the code on their widths.

use erfgs_events::Edge;
use erfgs_session::clock::{Clock, Errors, Evidence, FitError, Sample};
use serde::{Deserialize, Serialize};

use super::board::Board;
use erfgs_session::trigger::code::{self, SensedPulse};

/// Ticks of event cameras are microseconds.
pub const NS_PER_TICK: f64 = 1000.0;
/// How long one line of a clock of edges is, nanoseconds. Over five seconds a drift of 1 ppm a minute bends a clock by
/// 0.05 µs, and a hundred edges and more average their 1 µs away; twice as long it bends more than is averaged away, half as
/// long loses where edges are off by 10 µs (docs/results/precision.md).
pub const WINDOW_NS: i64 = 5_000_000_000;
/// Of arrivals, which are late by chance, few are early enough to tell anything.
const ARRIVALS_NS: i64 = 60_000_000_000;

/// How the edges of a camera and the pulses of the board fit together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Matched {
    /// Pulses that the board reported.
    pub given: u64,
    /// Pulses that the camera saw.
    pub seen: u64,
    /// Pulses of known index on both sides.
    pub matched: u64,
    /// Pulses that the camera saw with a width that is no symbol, or without a falling edge; a pulse that was high when the
    /// stream ended is not counted.
    pub unreadable: u64,
    /// Places where pulses were lost or doubled on the way to the camera.
    pub breaks: u64,
}

impl Matched {
    /// Of two stretches of one camera.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            given: self.given.max(other.given),
            seen: self.seen + other.seen,
            matched: self.matched + other.matched,
            unreadable: self.unreadable + other.unreadable,
            breaks: self.breaks + other.breaks,
        }
    }
}

/// Pulses from edges: a rising edge and the falling edge that follows it, on one channel.
#[must_use]
pub fn pulses(edges: &[Edge], channel: u8) -> Vec<SensedPulse> {
    let mut pulses: Vec<SensedPulse> = Vec::new();
    let mut high = false;
    for edge in edges.iter().filter(|edge| edge.channel == channel) {
        let t_us = i64::try_from(edge.t_us).unwrap_or(i64::MAX);
        if edge.rising {
            pulses.push(SensedPulse { rise: t_us, width_ns: None });
        } else if let Some(pulse) = pulses.last_mut().filter(|_| high) {
            pulse.width_ns = Some(t_us.saturating_sub(pulse.rise).saturating_mul(1000));
        }
        high = edge.rising;
    }
    pulses
}

/// The rising edges of a camera whose pulses the board knows, by the code on them.
#[must_use]
pub fn read(edges: &[Edge], board: &Board) -> (Vec<Sample>, Matched) {
    let seen = pulses(edges, edges.first().map_or(0, |edge| edge.channel));
    let decoded = code::decode(&seen);
    let samples: Vec<Sample> = std::iter::zip(&seen, &decoded.indices)
        .filter_map(|(pulse, index)| {
            let given = board.pulses.get(&(*index)?)?;
            Some(Sample { ticks: pulse.rise, session_ns: board.rise_ns(given) })
        })
        .collect();
    let matched = Matched {
        given: board.pulses.len() as u64,
        seen: seen.len() as u64,
        matched: samples.len() as u64,
        unreadable: decoded.unreadable as u64,
        breaks: decoded.breaks as u64,
    };
    (samples, matched)
}

/// Fits a camera's clock to edges that were matched with the board's pulses.
///
/// # Errors
/// Without edges.
pub fn fit_matched(samples: &[Sample]) -> Result<Clock, FitError> {
    Clock::fit(samples, NS_PER_TICK, Evidence::TriggerEdges, Errors::Symmetric, WINDOW_NS)
}

/// Fits a camera's clock to the board's by the pulses that both know.
///
/// # Errors
/// If no pulse could be matched.
pub fn fit(edges: &[Edge], board: &Board) -> Result<(Clock, Matched, Vec<Sample>), FitError> {
    let (samples, matched) = read(edges, board);
    Ok((fit_matched(&samples)?, matched, samples))
}

/// Fits a camera's clock to the arrivals of its packets: (last time in the packet, arrival in session time).
///
/// # Errors
/// If nothing arrived.
pub fn fit_arrivals(arrivals: &[Sample]) -> Result<Clock, FitError> {
    Clock::fit(arrivals, NS_PER_TICK, Evidence::Arrival, Errors::Late, ARRIVALS_NS)
}
