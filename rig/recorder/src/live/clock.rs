//! A quick look at a device's clock while it records. The fits that a reconstruction uses are made from the whole
//! session (`erfgs sync`); this one says whether something is wrong now.
//!
//! Data arrive late, never early: the line is laid under the earliest arrivals of each second of the last minute, and
//! the residuals are how far all recent arrivals lie above it.

use std::collections::VecDeque;

use erfgs_session::clock::{ClockFit, Evidence, Residuals};

use crate::ClockStatus;

/// Seconds that the line is laid through.
const SECONDS: usize = 60;
/// Seconds before there is a figure.
const ENOUGH: usize = 3;
/// Arrivals that the residuals are taken over.
const RECENT: usize = 512;
/// A device clock may be off by this much against the host's, as a ratio; more is another device or a restart.
const PLAUSIBLE: f64 = 2e-3;
/// Data that come after a break of the same clock are off by this much at most, nanoseconds.
const LATE: f64 = 2e7;

/// A clock that goes back by more than this began anew, as that of a recording does that is played in a loop: packets of one
/// stream come in order.
const BACKWARD_NS: f64 = 10e6;

/// The earliest arrival within one second.
#[derive(Clone, Copy, Debug)]
struct Earliest {
    second: i64,
    device_ns: f64,
    delay_ns: f64,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct ClockWatch {
    origin: Option<(i64, i64)>,
    earliest: VecDeque<Earliest>,
    recent: VecDeque<[f64; 2]>,
}

impl ClockWatch {
    /// Data of device time `device_ns` arrived at host time `host_ns`; `broken`: data of the device is missing before.
    pub fn sample(&mut self, device_ns: i64, host_ns: i64, broken: bool) {
        let (device_0, host_0) = *self.origin.get_or_insert((device_ns, host_ns));
        let device = (device_ns - device_0) as f64;
        let delay = (host_ns - host_0) as f64 - device;
        // A restarted device begins a new line.
        let jumped = |last: &[f64; 2]| {
            let strays = (delay - last[1]).abs();
            device < last[0] - BACKWARD_NS
                || strays > 1e9 + PLAUSIBLE * (device - last[0]).abs()
                // Behind a break the device may have started anew, or a playback have jumped.
                || broken && (device < last[0] || strays > LATE)
        };
        if self.recent.back().is_some_and(jumped) {
            *self = Self::default();
            return self.sample(device_ns, host_ns, false);
        }
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back([device, delay]);
        let sample =
            Earliest { second: (host_ns - host_0).div_euclid(1_000_000_000), device_ns: device, delay_ns: delay };
        match self.earliest.back_mut() {
            Some(last) if last.second == sample.second => {
                if delay < last.delay_ns {
                    *last = sample;
                }
            }
            _ => {
                if self.earliest.len() == SECONDS {
                    self.earliest.pop_front();
                }
                self.earliest.push_back(sample);
            }
        }
    }

    /// How the clock fares; `None` until some seconds are known.
    pub fn status(&self, basis: &str) -> Option<ClockStatus> {
        // The second that runs is not over: its earliest arrival may be yet to come.
        let known = self.earliest.len().checked_sub(1).filter(|&known| known >= ENOUGH)?;
        let (device_0, host_0) = self.origin?;
        let points = || self.earliest.iter().take(known);
        let count = known as f64;
        let mean_x = points().map(|point| point.device_ns).sum::<f64>() / count;
        let mean_y = points().map(|point| point.delay_ns).sum::<f64>() / count;
        let spread: f64 = points().map(|point| (point.device_ns - mean_x).powi(2)).sum();
        let slope = points().map(|point| (point.device_ns - mean_x) * (point.delay_ns - mean_y)).sum::<f64>() / spread;
        // What is off by more is no clock beside the host's: a recording that is played at another speed.
        if !slope.is_finite() || slope.abs() > PLAUSIBLE {
            return None;
        }
        let above = |[device, delay]: &[f64; 2]| (delay - mean_y - slope * (device - mean_x)).abs();
        let [first, last] = [self.earliest.front()?.device_ns, self.recent.back()?[0]].map(|ns| device_0 + ns as i64);
        let fit = ClockFit {
            evidence: Evidence::Arrival,
            origin_ticks: device_0 + mean_x as i64,
            origin_ns: host_0 + (mean_x + mean_y) as i64,
            ns_per_tick: 1.0 + slope,
            window_ticks: [first, last],
            residuals: Residuals::of(self.recent.iter().map(above).collect()),
            samples: self.recent.len() as u64,
            outliers: 0,
        };
        Some(ClockStatus::of(basis, fit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Arrivals every millisecond of a clock that gains `ppm`, delayed by `delay_us`.
    fn watch(seconds: i64, ppm: f64, delay_us: impl Fn(i64) -> i64) -> ClockWatch {
        let mut watch = ClockWatch::default();
        for ms in 0..1000 * seconds {
            let device_ns = (ms as f64 * 1e6 * (1.0 + ppm / 1e6)) as i64;
            watch.sample(7_000_000 + device_ns, 5_000_000_000 + ms * 1_000_000 + 1000 * delay_us(ms), false);
        }
        watch
    }

    #[test]
    fn the_rate_shows_through_late_arrivals() {
        // One of eight arrivals is prompt, the others up to 700 us late.
        let status = watch(20, 40.0, |ms| 100 * (ms % 8)).status("usb arrival").unwrap();
        // The line goes through the prompt arrivals: after 10 s the device is 400 us ahead.
        let fit = status.fit.as_ref().unwrap();
        assert!((fit.session_ns(10_007_400_000) - 15_000_000_000).abs() < 2_000, "{fit:?}");
        let [first, last] = fit.window_ticks;
        assert!((7_000_000..1_007_000_000).contains(&first) && last == 7_000_000 + 19_999_799_960, "{fit:?}");
        assert!((status.rate_ppm - 40.0).abs() < 0.1, "{status:?}");
        assert!((250.0..500.0).contains(&status.residual_p50_us), "{status:?}");
        assert!((600.0..800.0).contains(&status.residual_p95_us), "{status:?}");
    }

    #[test]
    fn there_is_no_figure_before_some_seconds_are_known() {
        assert!(watch(2, 0.0, |_| 0).status("").is_none());
        assert!(watch(5, 0.0, |_| 0).status("").is_some());
    }

    #[test]
    fn a_recording_in_a_loop_or_at_another_speed_has_no_absurd_clock() {
        // Loops of 0.7 s, which the host's clock knows nothing of.
        let mut watch = ClockWatch::default();
        for ms in 0..20_000 {
            watch.sample(ms % 700 * 1_000_000, ms * 1_000_000, false);
            assert!(watch.status("").is_none_or(|status| status.rate_ppm.abs() < 2000.0), "{ms}");
        }
        let mut slow = ClockWatch::default();
        (0..20_000).for_each(|ms| slow.sample(ms * 100_000, ms * 1_000_000, false));
        assert_eq!(slow.status(""), None);
    }

    #[test]
    fn a_restarted_device_begins_anew() {
        let mut watch = watch(10, 0.0, |_| 0);
        for ms in 0..6000 {
            watch.sample(ms * 1_000_000, 20_000_000_000 + ms * 1_000_000, false);
        }
        let status = watch.status("").unwrap();
        assert!(status.residual_p95_us < 1.0 && status.rate_ppm.abs() < 0.1, "{status:?}");
    }

    #[test]
    fn a_recording_that_starts_over_keeps_its_rate() {
        // Seven tenths of a second again and again: the device's time goes back, the host's goes on.
        let mut watch = ClockWatch::default();
        for round in 0..12 {
            for ms in 0..700 {
                let host_ns = round * 710_000_000 + ms * 1_000_000;
                watch.sample(3_000_000 + ms * 1_000_000, host_ns, round > 0 && ms == 0);
                let off = watch.status("").map_or(0.0, |status| status.rate_ppm.abs());
                assert!(off < 1.0, "{off} ppm in round {round}");
            }
        }
    }
}
