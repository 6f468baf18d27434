//! Frames: how often they come, and whether they follow the pulses.

use std::collections::BTreeSet;

use erfgs_recorder::DeviceSettings;
use erfgs_sync::{Board, Exposures};

use super::{Alone, Recorded, Subject};
use crate::check::{Check, CheckName};

const RATE: CheckName = CheckName::FrameRate;
const WAITS: CheckName = CheckName::WaitsForTrigger;
const PER_PULSE: CheckName = CheckName::FramePerPulse;
/// A rate may be off by this share, and by this before it is a fault.
const OFF: f64 = 0.02;
const FAR_OFF: f64 = 0.2;
/// A frame that comes so many periods after the one before it leaves a hole.
const HOLE: f64 = 1.5;
/// Pulses at the end of a recording whose frames may still be on their way, seconds, and at least so many.
const ON_THE_WAY_S: f64 = 0.2;
const FEWEST_ON_THE_WAY: u64 = 2;

fn is_frame_camera(subject: &Subject<'_>) -> bool {
    subject.description.encoding.is_frames() && !matches!(subject.entry.device.settings, DeviceSettings::Pattern(_))
}

pub fn rate(subject: &Subject<'_>, recorded: &Recorded<'_>) -> Option<Check> {
    let observed = recorded.observed;
    if !subject.description.encoding.is_frames() || subject.description.is_triggered() || observed.totals.packets == 0 {
        return None;
    }
    let setting = |name: &str| subject.description.settings.get(name)?.as_f64().filter(|hz| *hz > 0.0);
    let Some(asked_hz) = setting("asked_rate_hz").or(setting("rate_hz")) else {
        return Some(Check::not_tested(RATE, "no rate is known that it was asked for"));
    };
    let intervals = observed.intervals().1;
    let Some(found_hz) = observed.frames_per_s().filter(|_| intervals.median_us > 0.0) else {
        return Some(Check::not_tested(RATE, "fewer than three frames came"));
    };
    // Holes are losses; the rate is that of the frames between them.
    let median_hz = 1e6 / intervals.median_us;
    let gaps = observed.missing_frames + observed.totals.discontinuities;
    let rate_hz = if gaps > 0 { median_hz } else { found_hz };
    let off = (rate_hz / asked_hz - 1.0).abs();
    let found = format!("{rate_hz:.2} Hz of the {asked_hz:.2} Hz asked for");
    let remedy = "a long exposure, a slow link or a format with fewer rates lowers it: shorten the exposure, use USB 3, or \
                  write the rate that it has into the rig's file";
    if off > FAR_OFF {
        return Some(Check::fault(RATE, found, remedy));
    }
    if off > OFF {
        return Some(Check::warning(RATE, found, remedy));
    }
    // Arrivals are late as the host is busy; stamps are not.
    let holes = observed
        .frames_ns
        .windows(2)
        .filter(|pair| (pair[1].saturating_sub(pair[0])) as f64 / 1e3 > HOLE * intervals.median_us);
    let holes = if observed.stamped_by.is_some() { holes.count() as u64 } else { 0 };
    if holes > gaps {
        let found = format!("{found}, with {holes} holes of more than {HOLE} periods");
        return Some(Check::warning(
            RATE,
            found,
            "switch off what the camera sets by itself (exposure), and test again",
        ));
    }
    Some(Check::ok(RATE, found))
}

/// Without the board's pulses a triggered camera is silent.
pub fn waits_for_trigger(subject: &Subject<'_>) -> Option<Check> {
    if !is_frame_camera(subject) || !subject.description.is_triggered() {
        return None;
    }
    Some(match &subject.entry.alone {
        Alone::Recorded(recording) => {
            let frames = recording.stream(&subject.entry.device.id).map_or(0, |observed| observed.totals.packets);
            if frames == 0 {
                Check::ok(WAITS, format!("no frame without a pulse in {:.1} s", recording.seconds))
            } else {
                let found = format!("{frames} frames came in {:.1} s without a pulse", recording.seconds);
                let remedy = "switch the camera's trigger mode on; if it is on, its input floats: wire its ground, and give the \
                              board's output a pull-down resistor";
                Check::fault(WAITS, found, remedy)
            }
        }
        Alone::NotStarted(_) => Check::not_tested(WAITS, "it did not start"),
        Alone::Skipped(why) => Check::not_tested(WAITS, why.clone()),
    })
}

/// Each pulse gives one frame.
pub fn frame_per_pulse(subject: &Subject<'_>) -> Option<Check> {
    if !is_frame_camera(subject) || !subject.description.is_triggered() {
        return None;
    }
    let board = match subject.pulses.given(PER_PULSE) {
        Ok(board) => board,
        Err(not_tested) => return Some(not_tested),
    };
    let Some(recorded) = subject.together() else {
        return Some(Check::not_tested(PER_PULSE, "it was not recorded with the board"));
    };
    let (given, frames) = (board.pulses.len() as u64, recorded.observed.totals.packets);
    let wire = "check the wire from the board's output to the camera's trigger input, its ground and its voltage";
    if frames == 0 {
        return Some(Check::fault(PER_PULSE, format!("no frame for {given} pulses"), wire));
    }
    let exposures = recorded.recording.sync.stream(&subject.entry.device.id).and_then(|sync| sync.exposures.as_ref());
    let Some(exposures) = exposures.filter(|exposures| !exposures.pulse.is_empty()) else {
        return Some(Check::fault(PER_PULSE, format!("none of {frames} frames fits one of {given} pulses"), wire));
    };
    let [without_frame, without_pulse] = match board.period_ns() {
        Some(period_ns) if recorded.observed.stamped_by.is_some() => {
            by_stamps(&recorded.observed.frames_ns, given, period_ns)
        }
        _ => by_match(exposures, board),
    };
    if without_frame == 0 && without_pulse == 0 {
        let spread_us = exposures.residuals.p95_ns / 1e3;
        let found = format!("{frames} frames for {given} pulses, stamps within {spread_us:.0} µs (95 %)");
        return Some(Check::ok(PER_PULSE, found));
    }
    let found = format!(
        "{without_frame} of {given} pulses gave no frame, and {without_pulse} of {frames} frames have no pulse"
    );
    let remedy =
        "lower the board's rate or the exposure, so that the camera is ready for each pulse; then look at its wire";
    Some(Check::fault(PER_PULSE, found, remedy))
}

/// Pulses at the end whose frames may be on their way.
fn on_the_way(period_ns: i64) -> u64 {
    FEWEST_ON_THE_WAY.max((1e9 * ON_THE_WAY_S / period_ns.max(1) as f64) as u64)
}

/// Pulses that gave no frame, but for the last ones, and frames that have no pulse: by the intervals between stamps, which are those
/// between pulses, however busy the host is.
fn by_stamps(frames_ns: &[i64], given: u64, period_ns: i64) -> [u64; 2] {
    let (mut holes, mut extra) = (0, 0);
    for pair in frames_ns.windows(2) {
        let periods = (pair[1].saturating_sub(pair[0]) as f64 / period_ns.max(1) as f64).round();
        holes += (periods - 1.0).max(0.0) as u64;
        extra += u64::from(periods < 1.0);
    }
    let frames = frames_ns.len() as u64 - extra;
    // The train of frames with its holes filled is as long as that of pulses.
    let missing_at_ends = given.saturating_sub(frames + holes);
    let missing_at_ends = if missing_at_ends > on_the_way(period_ns) { missing_at_ends } else { 0 };
    [(holes + missing_at_ends).min(given), extra + (frames + holes).saturating_sub(given)]
}

/// The same of frames without stamps: by the pulses that their arrivals fit.
fn by_match(exposures: &Exposures, board: &Board) -> [u64; 2] {
    let on_the_way = on_the_way(board.period_ns().unwrap_or(i64::MAX));
    let last = board.pulses.keys().next_back().copied().unwrap_or(0).saturating_sub(on_the_way);
    let matched: BTreeSet<u64> = exposures.pulse.iter().copied().collect();
    let without_frame = board.pulses.keys().filter(|&&pulse| pulse <= last && !matched.contains(&pulse)).count() as u64;
    [without_frame, exposures.unmatched]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_between_stamps_tell_holes_and_frames_too_many() {
        let period_ns = 25_000_000;
        let train = |pulses: &[i64]| pulses.iter().map(|pulse| 7_000 + pulse * period_ns).collect::<Vec<i64>>();
        let all: Vec<i64> = (0..40).collect();
        let without = |gone: &[i64]| all.iter().copied().filter(|pulse| !gone.contains(pulse)).collect::<Vec<i64>>();
        assert_eq!(by_stamps(&train(&all), 40, period_ns), [0, 0]);
        assert_eq!(by_stamps(&train(&without(&[5, 6, 20])), 40, period_ns), [3, 0]);
        // The last ones are on their way; that so many more are is none.
        assert_eq!(by_stamps(&train(&all[..34]), 40, period_ns), [0, 0]);
        assert_eq!(by_stamps(&train(&all[..30]), 40, period_ns), [10, 0]);
        let mut doubled = train(&all);
        doubled.insert(11, doubled[10] + 2_000_000);
        assert_eq!(by_stamps(&doubled, 40, period_ns), [0, 1]);
        // A camera that runs freely begins before the board.
        assert_eq!(by_stamps(&train(&(-12..40).collect::<Vec<_>>()), 40, period_ns), [0, 12]);
        assert!(by_stamps(&train(&(0..80).collect::<Vec<_>>()), 40, 2 * period_ns)[1] > 30);
    }
}
