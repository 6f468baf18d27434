//! Frames matched with the pulses that triggered them, and the middles of their exposures.

use erfgs_session::clock::{Exposure, Residuals};

use super::{
    board::Board,
    even::Even,
    exposures::{Exposures, median},
};

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

/// Matches frames with pulses. A frame is stamped when its transfer begins, after its exposure and before the next one
/// ends: its pulse is the last whose exposure was over. All frames of a camera lag by about the same behind the end of their
/// exposures, which decides for those whose stamps are off.
///
/// `exposure_ns` is the exposure that the camera was set to; without it, the camera exposes while its trigger is high, each
/// frame as long as its own pulse.
#[must_use]
pub fn match_pulses(frames: &[Arrived], board: &Board, exposure_ns: Option<i64>) -> Exposures {
    let shots: Vec<Shot> = board
        .pulses
        .iter()
        .map(|(&pulse, line)| {
            let length_ns = exposure_ns.unwrap_or_else(|| Board::width_ns(line));
            Shot { pulse, exposure: Exposure::beginning(board.rise_ns(line), length_ns) }
        })
        .collect();
    match board.period_ns() {
        Some(period_ns) => match_shots(frames, &shots, period_ns, EARLY_NS),
        None => Exposures { unmatched: frames.len() as u64, ..Exposures::default() },
    }
}

/// As [`match_pulses`], with exposures that come every `period_ns`; a frame may be stamped `early_ns` before its own ends.
pub(super) fn match_shots(frames: &[Arrived], shots: &[Shot], period_ns: i64, early_ns: i64) -> Exposures {
    let lags = frames.iter().filter_map(|frame| {
        let at = shots.partition_point(|shot| shot.close_ns() <= frame.stamp_ns.saturating_add(early_ns));
        let shot = shots.get(at.checked_sub(1)?)?;
        // Frames of before and after the train would say nothing.
        let behind = |at_ns: i64| frame.stamp_ns.saturating_sub(at_ns);
        (behind(shot.exposure.mid_ns) < 2 * period_ns).then(|| behind(shot.close_ns()))
    });
    let Some(lag_ns) = median(lags.collect()) else {
        return Exposures { unmatched: frames.len() as u64, ..Exposures::default() };
    };
    let mut exposures = Exposures::default();
    let mut distances = Vec::new();
    for frame in frames {
        // The pulse whose exposure ends nearest to where the lag puts the end of this frame's.
        let wanted = frame.stamp_ns.saturating_sub(lag_ns);
        let at = shots.partition_point(|shot| shot.close_ns() < wanted);
        let nearest = [at.checked_sub(1), Some(at)]
            .into_iter()
            .flatten()
            .filter_map(|at| shots.get(at))
            .min_by_key(|shot| shot.close_ns().abs_diff(wanted))
            .filter(|shot| shot.close_ns().abs_diff(wanted) <= period_ns.unsigned_abs() / 2)
            // One pulse gives one frame.
            .filter(|shot| exposures.pulse.last().is_none_or(|&last| shot.pulse > last));
        match nearest {
            Some(shot) => {
                exposures.sequence.push(frame.sequence);
                exposures.pulse.push(shot.pulse);
                exposures.mid_ns.push(shot.exposure.mid_ns);
                exposures.exposure_ns.extend(shot.exposure.length_ns);
                distances.push(shot.close_ns().abs_diff(wanted) as f64);
            }
            None => exposures.unmatched += 1,
        }
    }
    if let (Some(first), Some(last)) = (exposures.pulse.first(), exposures.pulse.last()) {
        exposures.missed_pulses = (last - first + 1).saturating_sub(exposures.pulse.len() as u64);
    }
    // Behind the middle of a frame of the usual length.
    let usual = exposures.usual_ns();
    exposures.lag_ns = lag_ns.saturating_add(usual - usual / 2);
    exposures.residuals = Residuals::of(distances);
    exposures
}

/// A pulse, and the exposure of a camera that it triggers or that it shows.
pub(super) struct Shot {
    pub pulse: u64,
    pub exposure: Exposure,
}

impl Shot {
    fn close_ns(&self) -> i64 {
        self.exposure.span_ns()[1]
    }
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
        exposure_ns: exposure_ns.map_or_else(Vec::new, |exposure_ns| vec![exposure_ns; frames.len()]),
        lag_ns,
        residuals: even.residuals,
        fitted: even.fitted,
        ..Exposures::default()
    }
}
