//! `erfgs devices --selftest`: a rig tests itself.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use erfgs_base::calendar::DateTime;
use erfgs_rig::usb::LibusbBus;
use erfgs_selftest::{Check, Options, Report, SelftestError, Step, Verdict, run as test};

use crate::{
    errors::{Stopped, Usage, not_over},
    interrupt,
    record::load_rig,
    terminal::{Terminal, table},
};

/// Recordings of a test are as long as this at least and at most, seconds.
const SECONDS: std::ops::RangeInclusive<f64> = 0.5..=600.0;

/// The words of a test.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Test this rig: open each device, record it alone and with all others, and say what is wrong.
    #[arg(long, value_name = "RIG.toml", conflicts_with_all = ["probe", "at"])]
    pub selftest: Option<PathBuf>,
    /// How long each recording of the test is, 0.5 to 600. Clocks are known the better the longer.
    #[arg(long, value_name = "N", default_value_t = 2.0, requires = "selftest")]
    seconds: f64,
    /// The report to write. Default: selftest-DATE-TIME.json.
    #[arg(long, value_name = "FILE.json", requires = "selftest")]
    out: Option<PathBuf>,
    /// Overwrite a report that exists.
    #[arg(long, requires = "selftest")]
    force: bool,
    /// Keep the recordings of the test, with what the cameras saw, in this folder.
    #[arg(long, value_name = "FOLDER", requires = "selftest")]
    keep: Option<PathBuf>,
}

/// Tests the rig at `path`; fails where a check finds a fault.
pub fn run(path: &Path, arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    if !SECONDS.contains(&arguments.seconds) {
        let (least, most) = SECONDS.into_inner();
        return Err(Usage(format!("--seconds {}: write a number from {least} to {most}", arguments.seconds)).into());
    }
    let out = arguments.out.clone().unwrap_or_else(|| PathBuf::from(name(SystemTime::now())));
    not_over(&out, arguments.force)?;
    let rig = load_rig(path)?;
    let options = Options {
        length: Duration::from_secs_f64(arguments.seconds),
        keep: arguments.keep.clone(),
        stop: interrupt::stop_flag("the devices are being stopped")?,
    };
    let mut last = String::new();
    let mut tell = |step: Step<'_>| {
        let text = describe(step, arguments.seconds);
        if text != last {
            terminal.note(&text);
            last = text;
        }
    };
    let report = match test(&rig, &(Arc::new(LibusbBus) as _), &options, &mut tell) {
        Err(error @ SelftestError::Stopped) => return Err(Stopped(error.to_string()).into()),
        report => report?,
    };
    // What was found is printed, even if it cannot be written.
    let saved = report.save(&out);
    terminal.result(&report, || text(&report, &out))?;
    saved?;
    let faults = count(&report, Verdict::Fault);
    if faults > 0 {
        anyhow::bail!("the rig has {faults} {}, listed in {}", plural(faults, "fault"), out.display());
    }
    Ok(())
}

fn describe(step: Step<'_>, seconds: f64) -> String {
    match step {
        Step::Opening { device } => format!("opening {device}"),
        Step::Recording { device: Some(device), .. } => format!("recording {device} alone, {seconds} s"),
        Step::Recording { device: None, .. } => format!("recording all devices, {seconds} s"),
    }
}

/// `selftest-20260131-235959.json`, in UTC.
fn name(now: SystemTime) -> String {
    let seconds = now.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let DateTime { year, month, day, hour, minute, second } = DateTime::of_seconds(seconds.cast_signed());
    format!("selftest-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}.json")
}

fn count(report: &Report, verdict: Verdict) -> usize {
    report.checks.iter().filter(|check| check.verdict == verdict).count()
}

fn plural(count: usize, what: &str) -> String {
    if count == 1 { what.to_owned() } else { format!("{what}s") }
}

/// A line a check, with a second one that says what to do, and the sum.
fn text(report: &Report, out: &Path) -> String {
    let rows = report.checks.iter().flat_map(|check| {
        let Check { check: name, device, verdict, found, remedy } = check;
        let device = if device.is_empty() { "rig" } else { device };
        let line = [verdict.name(), device, name.name(), found].map(str::to_owned).to_vec();
        let remedy = ["", "", "", remedy].map(str::to_owned).to_vec();
        [Some(line), (!check.remedy.is_empty()).then_some(remedy)].into_iter().flatten()
    });
    let [faults, warnings, ok, not_tested] =
        [Verdict::Fault, Verdict::Warning, Verdict::Ok, Verdict::NotTested].map(|verdict| count(report, verdict));
    format!(
        "{}\n{faults} {}, {warnings} {}, {ok} ok, {not_tested} not tested\nwritten: {}\n",
        table(&rows.collect::<Vec<_>>()),
        plural(faults, "fault"),
        plural(warnings, "warning"),
        out.display()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_that_nobody_named_is_called_by_its_time() {
        assert_eq!(name(UNIX_EPOCH + Duration::from_secs(1_798_761_599)), "selftest-20261231-235959.json");
    }
}
