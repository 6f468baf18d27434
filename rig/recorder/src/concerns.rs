//! What to warn of while a rig runs: a disk that is nearly full, a device's clock that cannot be trusted.

use std::collections::BTreeSet;

use super::status::Status;

/// A disk that holds the data for less than this, seconds, is warned of; for less than the second, again.
const DISK_S: [f64; 2] = [600.0, 60.0];
/// A device's clock that is off by more, millionths, is none that a camera has: crystals stay within 100.
const RATE_PPM: f64 = 300.0;
/// Data that arrive later than this after the earliest ones, microseconds (95 of 100), were held up on the way.
const LATE_US: f64 = 100_000.0;
/// Samples before a clock is judged.
const ENOUGH: u64 = 256;

/// What was warned of and has not passed.
#[derive(Debug, Default)]
pub(super) struct Concerns {
    known: BTreeSet<(String, &'static str)>,
}

impl Concerns {
    /// What is new to warn of: the stream, or an empty name, and the words. What has passed may be warned of again.
    pub fn of(&mut self, status: &Status) -> Vec<(String, String)> {
        let mut found: Vec<(String, &'static str, String)> = Vec::new();
        if let Some(seconds) = status.disk.seconds_left {
            let says = format!(
                "the disk has room for {} more at this rate, without the reserve: free some space, or record to another disk",
                if seconds >= 90.0 { format!("{:.0} min", seconds / 60.0) } else { format!("{seconds:.0} s") }
            );
            let kinds = ["disk", "disk, at last"];
            let low = DISK_S.iter().zip(kinds).filter(|&(&limit, _)| seconds < limit);
            found.extend(low.map(|(_, kind)| (String::new(), kind, says.clone())).take(2));
        }
        for stream in &status.streams {
            let Some(clock) = stream.clock.as_ref().filter(|clock| clock.samples >= ENOUGH) else { continue };
            if clock.rate_ppm.abs() > RATE_PPM {
                let says = format!(
                    "its clock differs by {:.0} ppm from the computer's, more than any crystal: check whether the device restarted, \
                     and whether the computer's clock source is stable (erfgs doctor)",
                    clock.rate_ppm
                );
                found.push((stream.id.clone(), "rate", says));
            }
            if clock.residual_p95_us > LATE_US {
                let says = format!(
                    "its data arrive up to {:.0} ms late: the computer or the bus is overloaded. Without a trigger board clocks are \
                     fitted to arrival times and are as inaccurate",
                    clock.residual_p95_us / 1e3
                );
                found.push((stream.id.clone(), "late", says));
            }
        }
        let now: BTreeSet<(String, &'static str)> = found.iter().map(|(id, kind, _)| (id.clone(), *kind)).collect();
        let known = std::mem::replace(&mut self.known, now);
        let new = found.into_iter().filter(|(id, kind, _)| !known.contains(&(id.clone(), *kind)));
        let mut messages: Vec<(String, String)> = new.map(|(id, _, says)| (id, says)).collect();
        messages.dedup();
        messages
    }
}

#[cfg(test)]
mod tests {
    use erfgs_session::source::{Description, Encoding};

    use super::*;
    use crate::{ClockStatus, DiskStatus, StreamStatus, status::blank};

    fn status(seconds_left: Option<f64>, rate_ppm: f64, residual_p95_us: f64) -> Status {
        let description = Description {
            id: "left".into(),
            model: String::new(),
            serial: String::new(),
            encoding: Encoding::TriggerLines,
            width: 0,
            height: 0,
            start_order: 0,
            settings: serde_json::Map::new(),
        };
        let clock = ClockStatus { rate_ppm, residual_p95_us, samples: ENOUGH, ..ClockStatus::default() };
        Status {
            disk: DiskStatus { seconds_left, ..DiskStatus::default() },
            streams: vec![StreamStatus { clock: Some(clock), ..blank(&description) }],
            ..Status::default()
        }
    }

    #[test]
    fn a_disk_is_warned_of_twice_and_again_only_after_it_had_room() {
        let mut concerns = Concerns::default();
        let mut say = |seconds| concerns.of(&status(seconds, 0.0, 0.0)).len();
        let seconds =
            [None, Some(1e4), Some(500.0), Some(499.0), Some(59.0), Some(3.0), Some(1e4), Some(30.0), Some(29.0)];
        assert_eq!(seconds.map(&mut say), [0, 0, 1, 0, 1, 0, 0, 1, 0]);
        assert!(concerns.of(&status(Some(1e4), 0.0, 0.0)).is_empty());
        assert!(concerns.of(&status(Some(300.0), 0.0, 0.0))[0].1.contains("room for 5 min"));
    }

    #[test]
    fn clocks_that_no_camera_has_are_named() {
        let mut concerns = Concerns::default();
        assert!(concerns.of(&status(None, 80.0, 900.0)).is_empty());
        let messages = concerns.of(&status(None, -4000.0, 400_000.0));
        assert_eq!(messages.len(), 2, "{messages:?}");
        assert!(messages.iter().all(|(stream, _)| stream == "left"));
        assert!(messages[0].1.contains("-4000 ppm") && messages[1].1.contains("400 ms late"), "{messages:?}");
        assert!(concerns.of(&status(None, -4001.0, 400_000.0)).is_empty(), "said once");
    }
}
