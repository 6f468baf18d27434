//! The times of a camera's own clock, where its stamps have one, brought to session time.
//!
//! A camera that stamps each exposure itself does so without the jitter of the way to us; what is not known is when its clock
//! began, and how fast it runs. Frames arrive late and never early, so that the lower envelope of their arrivals tells both,
//! but for the least delay of a frame, which is what frames of other cameras lag by, too.

use std::{collections::VecDeque, ops::Range};

use erfgs_session::clock::{Clock, Errors, Evidence, Sample};

/// A stamp counts nanoseconds.
const NS_PER_TICK: f64 = 1.0;
/// Rates drift with the temperature.
const WINDOW_NS: i64 = 30_000_000_000;
/// Fewer frames tell no clock.
const MIN_FRAMES: usize = 10;
/// A clock of which more arrivals lie before it is none: some cameras' jump.
const MANY_OUTLIERS: f64 = 0.03;

/// A clock that is so much ahead of what it was has jumped.
const JUMP_NS: i64 = 20_000_000;
/// What it was is told by so many frames, over which it hardly drifts.
const NEAR_FRAMES: usize = 200;
/// A frame may arrive so much before its time and still be right.
const EARLY_NS: i64 = 1_000_000;

/// A frame's stamp by its camera, and its arrival, session nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stamped {
    pub camera_ns: i64,
    pub arrival_ns: i64,
    /// Whether the camera began anew before it, and its clock with it.
    pub anew: bool,
}

/// When frames would have arrived if all took as long as the fastest: nothing where the clock cannot be had, or a frame has no
/// stamp of it.
pub(super) fn settle(frames: &[Option<Stamped>]) -> Vec<Option<i64>> {
    let mut times = vec![None; frames.len()];
    for range in epochs(frames) {
        let stamped = || frames[range.clone()].iter().flatten();
        let samples: Vec<Sample> =
            stamped().map(|frame| Sample { ticks: frame.camera_ns, session_ns: frame.arrival_ns }).collect();
        if samples.len() < MIN_FRAMES {
            continue;
        }
        let clock = Clock::fit(&samples, NS_PER_TICK, Evidence::Arrival, Errors::Late, WINDOW_NS);
        let Some(clock) = clock.ok().filter(|clock| clock.outlier_share() <= MANY_OUTLIERS) else { continue };
        for (time, frame) in times[range.clone()].iter_mut().zip(&frames[range]) {
            let at = frame.map(|frame| (clock.session_ns(frame.camera_ns), frame.arrival_ns));
            // Nothing arrives before its time: that stamp is wrong.
            *time = at.filter(|(at_ns, arrival_ns)| at_ns - arrival_ns <= EARLY_NS).map(|(at_ns, _)| at_ns);
        }
    }
    times
}

/// Where one clock runs: from one beginning of the camera to the next. A clock that goes back has begun anew, whatever is said, and
/// one that is suddenly ahead has jumped: nothing arrives so much earlier than before.
fn epochs(frames: &[Option<Stamped>]) -> Vec<Range<usize>> {
    let mut epochs: Vec<Range<usize>> = Vec::new();
    let mut last_ns = i64::MIN;
    let mut delays = VecDeque::with_capacity(NEAR_FRAMES);
    for (index, frame) in frames.iter().enumerate() {
        let delay = |frame: &Stamped| frame.arrival_ns.saturating_sub(frame.camera_ns);
        let least = delays.iter().min();
        let anew = frame.is_some_and(|frame| {
            let ahead = least.is_some_and(|least: &i64| least.saturating_sub(delay(&frame)) > JUMP_NS);
            frame.anew || frame.camera_ns < last_ns || ahead
        });
        if anew {
            delays.clear();
        }
        match epochs.last_mut() {
            Some(epoch) if !anew => epoch.end = index + 1,
            _ => epochs.push(index..index + 1),
        }
        if let Some(frame) = frame {
            last_ns = frame.camera_ns;
            if delays.len() == NEAR_FRAMES {
                delays.pop_front();
            }
            delays.push_back(delay(frame));
        }
    }
    epochs
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Frames each 20 ms of a clock that is fast by 100 ppm and began `began_ns` before; they arrive 7 ms late and more.
    fn frames(count: i64, began_ns: i64, from_ns: i64) -> Vec<Option<Stamped>> {
        let frame = |index: i64| {
            let true_ns = from_ns + index * 20 * MS;
            let camera_ns = began_ns + index * 20 * MS + index * 2000;
            let late_ns = 7 * MS + if index % 3 == 0 { 0 } else { index * 62_710_561 % 4_000_000 };
            Some(Stamped { camera_ns, arrival_ns: true_ns + late_ns, anew: false })
        };
        (0..count).map(frame).collect()
    }

    #[test]
    fn the_jitter_of_arrivals_is_gone_and_the_least_delay_stays() {
        let mut frames = frames(300, 5_000_000_000, 1_000 * MS);
        frames[17] = None;
        let times = settle(&frames);
        assert_eq!(times[17], None);
        for (index, time) in (0..).zip(&times).filter(|(_, time)| time.is_some()) {
            let off_ns = time.unwrap() - (1_000 * MS + index * 20 * MS + 7 * MS);
            assert!(off_ns.abs() < 1000, "frame {index} is off by {off_ns} ns");
        }
    }

    #[test]
    fn a_camera_that_begins_anew_has_another_clock() {
        let mut frames = frames(50, 9_000_000_000, 0);
        frames.extend(self::frames(50, 1000, 3_000 * MS));
        for anew in [false, true] {
            frames[50].as_mut().unwrap().anew = anew;
            let times = settle(&frames);
            let off_ns = times[60].map(|time| time - (3_000 * MS + 10 * 20 * MS + 7 * MS));
            assert!(off_ns.is_some_and(|off_ns| off_ns.abs() < 300_000), "{off_ns:?} of {times:?}");
        }
        // Too few frames tell nothing.
        assert_eq!(settle(&frames[..5]), vec![None; 5]);
    }

    #[test]
    fn a_clock_that_jumps_is_another_behind_the_jump() {
        let mut frames = frames(100, 0, 0);
        for frame in frames[40..].iter_mut().flatten() {
            frame.camera_ns += 300 * MS;
        }
        // One stamp is nonsense.
        frames[80].as_mut().unwrap().camera_ns += 1_000_000 * MS;
        let times = settle(&frames);
        assert_eq!(times[80], None);
        for (index, time) in (0..).zip(&times).filter(|(index, _)| *index != 80) {
            let off_ns = time.unwrap() - (index * 20 * MS + 7 * MS);
            assert!(off_ns.abs() < 300_000, "frame {index} is off by {off_ns} ns");
        }
    }
}
