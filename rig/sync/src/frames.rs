//! Frames matched with the pulses that triggered them, and the middles of their exposures.

use erfgs_session::clock::Residuals;
use serde::{Deserialize, Serialize};

use super::{board::Board, even::Even};

/// The kernel may stamp a frame so much before the exposure ends by our clocks and still belong to it.
const EARLY_NS: i64 = 1_000_000;

/// A frame as it arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrived {
    /// The packet's sequence number.
    pub sequence: u64,
    /// The kernel's stamp, or the arrival where there is none; session time, nanoseconds.
    pub stamp_ns: i64,
}

/// The frames of a stream in session time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Exposures {
    /// Sequence numbers of the packets.
    pub sequence: Vec<u64>,
    /// The pulse that triggered each frame; empty for a free-running camera.
    pub pulse: Vec<u64>,
    /// The middle of each exposure, nanoseconds of session time.
    pub mid_ns: Vec<i64>,
    /// How long frames were exposed, nanoseconds: as the camera was set, or while its trigger was high; absent where nothing
    /// tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ns: Option<i64>,
    /// How long after the middle of the exposure a frame is stamped, nanoseconds: the median that was found (triggered),
    /// or what was assumed or found by a flash and has been taken off.
    pub lag_ns: i64,
    /// Distances of the stamps from that lag. Of a free-running camera whose frames do not come at even intervals, how much
    /// neighbouring stamps jitter.
    pub residuals: Residuals,
    /// Frames of a free-running camera whose stamps were fitted with a period; the others have their stamps as they are.
    #[serde(default)]
    pub fitted: u64,
    /// Pulses between the first and the last matched one that gave no frame.
    pub missed_pulses: u64,
    /// Frames that belong to no pulse of the board.
    pub unmatched: u64,
}

/// Matches frames with pulses. A frame is stamped when its transfer begins, after its exposure and before the next one
/// ends: its pulse is the last whose exposure was over. All frames of a camera lag by about the same, which decides for
/// those whose stamps are off.
///
/// `exposure_ns` is the exposure that the camera was set to; without it, the camera exposes while its trigger is high.
#[must_use]
pub fn match_pulses(frames: &[Arrived], board: &Board, exposure_ns: Option<i64>) -> Exposures {
    let rises: Vec<(u64, i64, i64)> = board
        .pulses
        .iter()
        .map(|(&index, pulse)| (index, board.rise_ns(pulse), exposure_ns.unwrap_or_else(|| Board::width_ns(pulse))))
        .collect();
    let Some(period_ns) = board.period_ns() else {
        return Exposures { unmatched: frames.len() as u64, ..Exposures::default() };
    };
    let over = |&(_, rise, exposure): &(u64, i64, i64)| rise.saturating_add(exposure);
    let mut lags: Vec<i64> = frames
        .iter()
        .filter_map(|frame| {
            let at = rises.partition_point(|rise| over(rise) <= frame.stamp_ns.saturating_add(EARLY_NS));
            let (_, rise, exposure) = rises.get(at.checked_sub(1)?)?;
            // Frames of before and after the train would say nothing.
            Some(frame.stamp_ns - (rise + exposure / 2)).filter(|&lag| lag < 2 * period_ns)
        })
        .collect();
    if lags.is_empty() {
        return Exposures { unmatched: frames.len() as u64, ..Exposures::default() };
    }
    let middle = lags.len() / 2;
    let lag_ns = *lags.select_nth_unstable(middle).1;
    let mut widths: Vec<i64> = rises.iter().map(|&(_, _, exposure)| exposure).collect();
    let width = *widths.select_nth_unstable(rises.len() / 2).1;
    let mut exposures = Exposures { lag_ns, exposure_ns: Some(width), ..Exposures::default() };
    let mut distances = Vec::new();
    for frame in frames {
        // The pulse whose exposure lies nearest to where the lag puts this frame's.
        let wanted = frame.stamp_ns.saturating_sub(lag_ns);
        let mid = |&(_, rise, exposure): &(u64, i64, i64)| rise.saturating_add(exposure / 2);
        let at = rises.partition_point(|rise| mid(rise) < wanted);
        let nearest = [at.checked_sub(1), Some(at)]
            .into_iter()
            .flatten()
            .filter_map(|at| rises.get(at))
            .min_by_key(|rise| mid(rise).abs_diff(wanted))
            .filter(|rise| mid(rise).abs_diff(wanted) <= period_ns.unsigned_abs() / 2)
            // One pulse gives one frame.
            .filter(|rise| exposures.pulse.last().is_none_or(|&last| rise.0 > last));
        match nearest {
            Some(rise) => {
                exposures.sequence.push(frame.sequence);
                exposures.pulse.push(rise.0);
                exposures.mid_ns.push(mid(rise));
                distances.push(mid(rise).abs_diff(wanted) as f64);
            }
            None => exposures.unmatched += 1,
        }
    }
    if let (Some(first), Some(last)) = (exposures.pulse.first(), exposures.pulse.last()) {
        exposures.missed_pulses = (last - first + 1).saturating_sub(exposures.pulse.len() as u64);
    }
    exposures.residuals = Residuals::of(distances);
    exposures
}

/// The frames of a free-running camera: the kernel stamps the start of the transfer, when the exposure has just ended, so
/// that the middle lies half an exposure before. What the camera takes to read its sensor is not known and not taken off.
#[must_use]
pub fn free_running(frames: &[Arrived], even: &Even, exposure_ns: Option<i64>) -> Exposures {
    lagging(frames, even, exposure_ns.unwrap_or(0) / 2, exposure_ns)
}

/// Frames that are stamped `lag_ns` after the middle of their exposure, but for jitter: `even` is what it takes away.
#[must_use]
pub fn lagging(frames: &[Arrived], even: &Even, lag_ns: i64, exposure_ns: Option<i64>) -> Exposures {
    Exposures {
        sequence: frames.iter().map(|frame| frame.sequence).collect(),
        mid_ns: even.at_ns.iter().map(|at_ns| at_ns.saturating_sub(lag_ns)).collect(),
        lag_ns,
        exposure_ns,
        residuals: even.residuals,
        fitted: even.fitted,
        ..Exposures::default()
    }
}
