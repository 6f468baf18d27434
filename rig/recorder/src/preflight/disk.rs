//! The disk: its speed, measured by writing to it, and its room.

use std::{
    fs::File,
    io::{self, Write},
    path::Path,
    time::{Duration, Instant},
};

use erfgs_base::atomic::TrialFile;

use super::{Finding, Plan, rates::Rates};
use crate::host;

/// Bytes of one write of the measurement.
const BLOCK: usize = 4 << 20;
/// The measurement writes no more than this share of the room that is left.
const SHARE: u64 = 4;

const SLOW: &str = "record to a faster disk (NVMe), or lower frame rates and event rates";

pub(super) fn check(plan: &Plan<'_>, rates: &Rates) -> Vec<Finding> {
    let mut findings = vec![room(plan, rates)];
    if plan.disk_test > Duration::ZERO {
        findings.push(speed(measure_write_speed(plan.folder, plan.disk_test), rates, plan.folder));
    }
    findings
}

/// Writes into `folder` for about `duration` and gives bytes a second, with what the disk takes to confirm it. The
/// file is removed.
///
/// # Errors
/// If the folder cannot be written to.
pub fn measure_write_speed(folder: &Path, duration: Duration) -> io::Result<f64> {
    // One that was left by a recorder that was killed takes room, and goes with this.
    let trial = TrialFile::new(folder, ".erfgs-disk-test-")?;
    write_for(trial.file(), duration, host::disk_space(folder)?.free / SHARE)
}

fn write_for(mut file: &File, duration: Duration, most: u64) -> io::Result<f64> {
    // Numbers that no disk or file system compresses away.
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let block: Vec<u8> = std::iter::repeat_with(|| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state.to_le_bytes()
    })
    .take(BLOCK / 8)
    .flatten()
    .collect();
    let (begun, mut written) = (Instant::now(), 0_u64);
    while written == 0 || (begun.elapsed() < duration && written + (BLOCK as u64) < most) {
        file.write_all(&block)?;
        written += BLOCK as u64;
        // A cache that takes all at memory speed must not fool the measurement.
        if written.is_multiple_of(16 * BLOCK as u64) {
            file.sync_data()?;
        }
    }
    file.sync_data()?;
    Ok(written as f64 / begun.elapsed().as_secs_f64())
}

fn speed(measured: io::Result<f64>, rates: &Rates, folder: &Path) -> Finding {
    const CHECK: &str = "disk speed";
    let bytes_per_s = match measured {
        Ok(bytes_per_s) => bytes_per_s,
        Err(error) => {
            let says = format!("cannot write to '{}': {error}", folder.display());
            let remedy = match error.kind() {
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
                    "free some space, or record to another disk"
                }
                _ => "choose a folder that you may write to",
            };
            return Finding::refusal(CHECK, says, remedy);
        }
    };
    let says = format!(
        "the disk takes {:.0} MB/s; the streams send about {:.0} MB/s, up to {:.0} MB/s",
        bytes_per_s / 1e6,
        rates.steady / 1e6,
        rates.peak / 1e6
    );
    if bytes_per_s < rates.steady {
        Finding::refusal(CHECK, says, SLOW)
    } else if bytes_per_s < 1.2 * rates.peak {
        Finding::warning(CHECK, format!("{says}: bursts longer than the queues will lose data"), SLOW)
    } else {
        Finding::good(CHECK, says)
    }
}

fn room(plan: &Plan<'_>, rates: &Rates) -> Finding {
    const CHECK: &str = "disk space";
    let free = match host::disk_space(plan.folder) {
        Ok(space) => space.free,
        Err(error) => {
            let says = format!("cannot determine the free space of '{}': {error}", plan.folder.display());
            return Finding::warning(CHECK, says, "check it by hand");
        }
    };
    room_for(free, plan.reserve_bytes, plan.duration, rates)
}

fn room_for(on_disk: u64, reserve: u64, duration: Option<Duration>, rates: &Rates) -> Finding {
    const CHECK: &str = "disk space";
    let free = on_disk.saturating_sub(reserve);
    let minutes = |rate: f64| free as f64 / rate.max(1.0) / 60.0;
    let says = format!(
        "{:.1} GB are free, {:.1} of which are held in reserve: about {:.0} minutes, {:.0} while everything moves",
        on_disk as f64 / 1e9,
        reserve as f64 / 1e9,
        minutes(rates.steady),
        minutes(rates.peak)
    );
    if reserve >= on_disk {
        return Finding::refusal(CHECK, says, "make the reserve smaller, free some space, or record to another disk");
    }
    let wanted = duration.map_or(60.0, |duration| duration.as_secs_f64());
    if (free as f64) < wanted * rates.steady {
        Finding::refusal(CHECK, says, "free some space, record to another disk, or record for a shorter time")
    } else if (free as f64) < wanted * rates.peak {
        Finding::warning(CHECK, says, "the recording ends cleanly when the disk is full; free some space")
    } else {
        Finding::good(CHECK, says)
    }
}

#[cfg(test)]
mod tests {
    use super::{super::Verdict, *};

    const RATES: Rates = Rates { steady: 100e6, peak: 300e6 };

    #[test]
    fn disks_are_judged_by_what_the_streams_send() {
        let verdict = |mb_per_s: f64| speed(Ok(mb_per_s * 1e6), &RATES, Path::new("out")).verdict;
        assert_eq!(
            [90.0, 120.0, 350.0, 400.0].map(verdict),
            [Verdict::Refusal, Verdict::Warning, Verdict::Warning, Verdict::Good]
        );
        let denied = speed(Err(io::ErrorKind::PermissionDenied.into()), &RATES, Path::new("out"));
        assert!(denied.verdict == Verdict::Refusal && denied.remedy.contains("may write to"));
        let full = speed(Err(io::ErrorKind::StorageFull.into()), &RATES, Path::new("out"));
        assert!(full.verdict == Verdict::Refusal && full.remedy.contains("free some space"));
    }

    #[test]
    fn room_is_judged_by_how_long_the_recording_lasts() {
        let verdict =
            |gb: u64, seconds| room_for(gb * 1_000_000_000, 0, Some(Duration::from_secs(seconds)), &RATES).verdict;
        assert_eq!(verdict(10, 120), Verdict::Refusal);
        assert_eq!(verdict(20, 120), Verdict::Warning);
        assert_eq!(verdict(40, 120), Verdict::Good);
        assert!(room_for(12_000_000_000, 0, None, &RATES).says.contains("about 2 minutes"));
        let all = room_for(77_000_000_000, 100_000_000_000, None, &RATES);
        assert!(all.verdict == Verdict::Refusal && all.says.contains("77.0 GB are free"), "{}", all.says);
    }

    #[test]
    fn the_measurement_writes_and_leaves_nothing_not_even_of_one_that_was_killed() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(".erfgs-disk-test-123"), [0; 4096]).unwrap();
        assert!(measure_write_speed(folder.path(), Duration::from_millis(1)).unwrap() > 0.0);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(measure_write_speed(&folder.path().join("absent"), Duration::from_millis(1)).is_err());
    }
}
