//! When the frames of a video are shown, as its container says.

use std::{ffi::OsString, path::Path, process::Command};

use erfgs_base::children::{self, Ended};

use super::PATIENCE;

/// When the frames of a video are shown, from the first on.
#[derive(Clone, Debug, PartialEq)]
pub enum FrameTimes {
    /// At so many frames a second.
    Even(f64),
    /// At these times, nanoseconds.
    Uneven(Vec<i64>),
}

impl FrameTimes {
    /// The time of a frame after frame `first`, nanoseconds; `None` if there is no such frame.
    #[must_use]
    pub fn since(&self, first: u64, frame: u64) -> Option<i64> {
        match self {
            Self::Even(rate) => Some((frame.checked_sub(first)? as f64 * 1e9 / rate).round() as i64),
            Self::Uneven(times) => {
                let at = |frame: u64| times.get(usize::try_from(frame).ok()?).copied();
                Some(at(frame)? - at(first)?)
            }
        }
    }

    /// Frames a second, of uneven ones their mean.
    #[must_use]
    pub fn rate(&self) -> f64 {
        match self {
            Self::Even(rate) => *rate,
            Self::Uneven(times) => match times[..] {
                [first, .., last] if last > first => 1e9 * (times.len() - 1) as f64 / (last - first) as f64,
                _ => 1.0,
            },
        }
    }

    /// Whether the frames of two videos are shown at the same times, to a quarter of the time between two.
    #[must_use]
    pub fn agree(&self, other: &Self, frames: u64) -> bool {
        let quarter_ns = (0.25e9 / self.rate()) as u64;
        (0..frames).all(|frame| match (self.since(0, frame), other.since(0, frame)) {
            (Some(a), Some(b)) => a.abs_diff(b) <= quarter_ns,
            (None, None) => true,
            _ => false,
        })
    }

    /// Asks ffprobe, which comes with ffmpeg. `None` where the container says neither times nor a rate, or cannot be read.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let mut input = OsString::from("file:");
        input.push(path);
        let mut command = Command::new("ffprobe");
        command
            .args(["-v", "quiet", "-select_streams", "v:0", "-show_entries"])
            .args([
                "packet=pts,flags:stream=time_base,r_frame_rate,avg_frame_rate",
                "-of",
                "default=noprint_wrappers=1",
            ])
            .arg(input);
        // A frame takes a byte at least.
        let most = usize::try_from(std::fs::metadata(path).ok()?.len()).unwrap_or(usize::MAX);
        let mut probe = ProbeOutput::new(most);
        match children::run(command, PATIENCE, |line| probe.line(line)).ok()? {
            Ended::Itself(status) if status.success() => probe.times(),
            _ => None,
        }
    }
}

/// Two numbers above 0 with a stroke between.
fn ratio(text: &str) -> Option<[f64; 2]> {
    let (over, under) = text.split_once('/')?;
    Some([over.parse().ok()?, under.parse().ok()?]).filter(|ratio: &[f64; 2]| ratio[0] > 0.0 && ratio[1] > 0.0)
}

fn rate(text: &str) -> Option<f64> {
    ratio(text).map(|[over, under]| over / under).filter(|rate| (1e-4..1e6).contains(rate))
}

/// What ffprobe says.
#[derive(Debug, Default)]
struct ProbeOutput {
    /// Seconds in a unit of time.
    unit: Option<[f64; 2]>,
    /// The rates that the container says: that which holds for all frames, if one does, and their mean.
    rates: [Option<f64>; 2],
    /// Times of the packets that make frames, in units; `None` where one has none, or there are more than can be.
    units: Option<Vec<i64>>,
    most: usize,
    /// That of the packet whose lines are read.
    pts: Option<i64>,
    is_open: bool,
}

impl ProbeOutput {
    fn new(most: usize) -> Self {
        Self { units: Some(Vec::new()), most, ..Self::default() }
    }

    fn line(&mut self, line: &str) {
        match line.trim().split_once('=') {
            Some(("pts", text)) => (self.pts, self.is_open) = (text.parse().ok(), true),
            // Packets that only help to decode others are no frames.
            Some(("flags", flags)) if self.is_open => {
                self.is_open = false;
                if !flags.contains('D') {
                    let pts = self.units.as_ref().filter(|units| units.len() < self.most).and(self.pts);
                    self.units = self.units.take().zip(pts).map(|(mut units, pts)| {
                        units.push(pts);
                        units
                    });
                }
            }
            Some(("time_base", text)) => self.unit = ratio(text),
            Some(("r_frame_rate", text)) => self.rates[0] = rate(text),
            Some(("avg_frame_rate", text)) => self.rates[1] = rate(text),
            _ => {}
        }
    }

    fn times(self) -> Option<FrameTimes> {
        let [nominal, mean] = self.rates;
        let (Some(mut units), Some([over, under])) = (self.units.filter(|units| units.len() > 1), self.unit) else {
            return mean.or(nominal).map(FrameTimes::Even);
        };
        units.sort_unstable();
        let (first, tick_ns) = (units[0], 1e9 * over / under);
        let ns: Vec<i64> =
            units.iter().map(|&unit| (unit.saturating_sub(first) as f64 * tick_ns).round() as i64).collect();
        let units_long = units[units.len() - 1].saturating_sub(first).max(1) as f64;
        let measured = (ns.len() - 1) as f64 * under / (units_long * over);
        let is_even = |rate: &f64| {
            let bound_ns = (2.0 * tick_ns).max(0.01e9 / rate);
            ns.iter().enumerate().all(|(frame, &ns)| (ns as f64 - frame as f64 * 1e9 / rate).abs() <= bound_ns)
        };
        match [nominal, mean, Some(measured)].into_iter().flatten().find(is_even) {
            Some(rate) => Some(FrameTimes::Even(rate)),
            None => Some(FrameTimes::Uneven(ns)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What ffprobe writes of packets at these times of a unit.
    fn probed(units: &[&str], unit: &str, nominal: &str, mean: &str) -> Option<FrameTimes> {
        let packets: String = units.iter().map(|pts| format!("pts={pts}\nflags=K__\n")).collect();
        let text = format!("{packets}r_frame_rate={nominal}\navg_frame_rate={mean}\ntime_base={unit}\n");
        let mut probe = ProbeOutput::new(100);
        text.lines().for_each(|line| probe.line(line));
        probe.times()
    }

    #[test]
    fn even_frames_have_the_rate_that_is_said_and_uneven_ones_their_times() {
        // Packets come in the order in which they are decoded.
        let even = ["0", "1024", "256", "512", "768"];
        assert_eq!(probed(&even, "1/15360", "60/1", "60/1"), Some(FrameTimes::Even(60.0)));
        // Whole milliseconds, as Matroska has them.
        assert_eq!(probed(&["0", "33", "67", "100"], "1/1000", "30/1", "30/1"), Some(FrameTimes::Even(30.0)));
        let ntsc = probed(&["0", "1001", "2002"], "1/30000", "30000/1001", "30000/1001").unwrap();
        assert_eq!(ntsc.since(0, 2), Some(66_733_333));
        let uneven = probed(&["512", "1024", "3072"], "1/15360", "30/1", "23/1").unwrap();
        assert_eq!(uneven, FrameTimes::Uneven(vec![0, 33_333_333, 166_666_667]));
        assert_eq!((uneven.since(1, 2), uneven.since(0, 3)), (Some(133_333_334), None));
        // The rate that is said is wrong, and the frames are even all the same.
        assert_eq!(probed(&["0", "1000", "2000"], "1/15000", "25/1", "25/1"), Some(FrameTimes::Even(15.0)));
        // Without times the mean rate is what the container says.
        assert_eq!(probed(&["N/A", "N/A"], "1/25", "50/1", "25/1"), Some(FrameTimes::Even(25.0)));
        assert_eq!(probed(&[], "0/0", "0/0", "0/0"), None);
    }

    #[test]
    fn videos_of_different_rates_have_no_times_in_common() {
        let [a, b] = [60.0, 30.0].map(FrameTimes::Even);
        assert!(a.agree(&FrameTimes::Even(60.001), 100) && !a.agree(&b, 2) && a.agree(&b, 1));
        let gap = FrameTimes::Uneven(vec![0, 33_333_333, 100_000_000]);
        assert!(gap.agree(&gap, 3) && !gap.agree(&b, 3) && gap.agree(&b, 2) && !b.agree(&gap, 4));
    }
}
