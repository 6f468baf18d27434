//! Checks before a recording: will the disk, the buses and the memory carry what the devices send?
//!
//! Each check gives findings; what cannot be found out on this machine (no `/sys`, no permission) is left out rather
//! than guessed. A finding says what was measured, what is needed, and what to do.

mod disk;
mod rates;
mod system;
mod usb;

use std::{path::Path, time::Duration};

use erfgs_session::source::Description;
use serde::{Deserialize, Serialize};

pub use disk::measure_write_speed;
pub use rates::{Rates, rates};

/// How grave a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// As it should be.
    Good,
    /// Data may be lost under load, or the recording may end early.
    Warning,
    /// Data will be lost.
    Refusal,
}

/// What a check found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// What was looked at: `disk speed`, `usb`.
    pub check: String,
    /// How grave.
    pub verdict: Verdict,
    /// What was measured, and what is needed.
    pub says: String,
    /// What to do; empty if all is good.
    pub remedy: String,
}

impl Finding {
    fn good(check: &str, says: String) -> Self {
        Self { check: check.into(), verdict: Verdict::Good, says, remedy: String::new() }
    }

    fn warning(check: &str, says: String, remedy: &str) -> Self {
        Self { check: check.into(), verdict: Verdict::Warning, says, remedy: remedy.into() }
    }

    fn refusal(check: &str, says: String, remedy: &str) -> Self {
        Self { check: check.into(), verdict: Verdict::Refusal, says, remedy: remedy.into() }
    }
}

/// What is to be recorded.
#[derive(Clone, Copy, Debug)]
pub struct Plan<'a> {
    /// What the devices will deliver, one entry for each stream.
    pub streams: &'a [Description],
    /// The folder that the session goes to.
    pub folder: &'a Path,
    /// How long, if that is known.
    pub duration: Option<Duration>,
    /// Bytes that stay free.
    pub reserve_bytes: u64,
    /// Memory that all queues together may take, bytes.
    pub queue_bytes: u64,
    /// How long to write for a measurement of the disk; zero leaves it out.
    pub disk_test: Duration,
}

/// All checks, on this machine.
#[must_use]
pub fn check(plan: &Plan<'_>) -> Vec<Finding> {
    check_under(plan, Path::new("/"))
}

/// All checks with the system's files under `root`, as tests lay them out.
#[must_use]
pub fn check_under(plan: &Plan<'_>, root: &Path) -> Vec<Finding> {
    let rates = rates(plan.streams);
    let mut findings = disk::check(plan, &rates);
    findings.extend(usb::check(plan.streams, root));
    findings.extend(system::check(plan, root));
    findings.extend(plan.streams.iter().flat_map(settings));
    findings
}

/// The gravest verdict.
#[must_use]
pub fn worst(findings: &[Finding]) -> Verdict {
    findings.iter().map(|finding| finding.verdict).max().unwrap_or(Verdict::Good)
}

/// Settings that a driver could not bring about: it lists them under `not_applied`.
fn settings(stream: &Description) -> Option<Finding> {
    let missed = stream.settings.get("not_applied")?;
    let missed = match missed {
        serde_json::Value::Array(list) if list.is_empty() => return None,
        serde_json::Value::Null => return None,
        serde_json::Value::Array(list) => {
            list.iter().map(|item| item.as_str().map_or_else(|| item.to_string(), str::to_owned)).collect()
        }
        other => vec![other.as_str().map_or_else(|| other.to_string(), str::to_owned)],
    };
    let says = format!("'{}' did not accept: {}", stream.id, missed.join(", "));
    Some(Finding::warning("settings", says, "see `erfgs devices` for what the camera can do, or remove the setting"))
}
