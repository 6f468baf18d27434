//! What a check is called, and what it found.

use serde::{Deserialize, Serialize};

/// A check, by the name that reports have. Names stay as they are: people search for them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CheckName {
    /// The device can be opened and takes its settings.
    Opened,
    /// It is the device that the rig asks for.
    SerialNumber,
    /// It has the settings that the rig asks for.
    Settings,
    /// Its driver has nothing to warn of.
    DriverWarnings,
    /// Data comes, from the beginning to the end.
    Data,
    /// What comes can be decoded.
    Format,
    /// Nothing is lost on the way.
    Losses,
    /// Its clock runs at the rate that it should have.
    ClockRate,
    /// Its clock neither goes back nor jumps.
    ClockSteps,
    /// Its clock begins at zero when the device is started.
    ClockReset,
    /// Frames come as often as asked for.
    FrameRate,
    /// The device sends as much beside the others as alone.
    Bandwidth,
    /// A triggered camera gives no frame without a pulse.
    WaitsForTrigger,
    /// The trigger board answers, and keeps running.
    BoardAnswers,
    /// The trigger board gives pulses at the rate that it is set to.
    Pulses,
    /// Each pulse reaches the trigger input of an event camera.
    TriggerEdges,
    /// Each pulse gives one frame.
    FramePerPulse,
    /// The edges of a camera's strobe reach the trigger input of an event camera.
    StrobeEdges,
    /// The temperature of the device.
    Temperature,
}

impl CheckName {
    /// All of them, in the order of reports.
    pub const ALL: [Self; 19] = [
        Self::Opened,
        Self::SerialNumber,
        Self::Settings,
        Self::DriverWarnings,
        Self::Data,
        Self::Format,
        Self::Losses,
        Self::ClockRate,
        Self::ClockSteps,
        Self::ClockReset,
        Self::FrameRate,
        Self::Bandwidth,
        Self::WaitsForTrigger,
        Self::BoardAnswers,
        Self::Pulses,
        Self::TriggerEdges,
        Self::FramePerPulse,
        Self::StrobeEdges,
        Self::Temperature,
    ];

    /// As reports have it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Opened => "opened",
            Self::SerialNumber => "serial-number",
            Self::Settings => "settings",
            Self::DriverWarnings => "driver-warnings",
            Self::Data => "data",
            Self::Format => "format",
            Self::Losses => "losses",
            Self::ClockRate => "clock-rate",
            Self::ClockSteps => "clock-steps",
            Self::ClockReset => "clock-reset",
            Self::FrameRate => "frame-rate",
            Self::Bandwidth => "bandwidth",
            Self::WaitsForTrigger => "waits-for-trigger",
            Self::BoardAnswers => "board-answers",
            Self::Pulses => "pulses",
            Self::TriggerEdges => "trigger-edges",
            Self::FramePerPulse => "frame-per-pulse",
            Self::StrobeEdges => "strobe-edges",
            Self::Temperature => "temperature",
        }
    }
}

/// How grave it is, the gravest last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The rig or the recording gave no chance to find out.
    NotTested,
    /// As it should be.
    Ok,
    /// Recordings can be used, but something deserves a look.
    Warning,
    /// Recordings are wrong, or have holes.
    Fault,
}

impl Verdict {
    /// As reports have it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NotTested => "not-tested",
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Fault => "fault",
        }
    }
}

/// What a check found of a device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Check {
    /// Which check.
    pub check: CheckName,
    /// The device's id in the rig; empty for what concerns the whole rig.
    pub device: String,
    /// How grave it is.
    pub verdict: Verdict,
    /// What was found, with its figures; of what was not tested, why.
    pub found: String,
    /// What to do about it; empty where nothing is to be done.
    pub remedy: String,
}

impl Check {
    pub(crate) fn ok(check: CheckName, found: impl Into<String>) -> Self {
        Self::new(check, Verdict::Ok, found, "")
    }

    pub(crate) fn not_tested(check: CheckName, why: impl Into<String>) -> Self {
        Self::new(check, Verdict::NotTested, why, "")
    }

    pub(crate) fn warning(check: CheckName, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(check, Verdict::Warning, found, remedy)
    }

    pub(crate) fn fault(check: CheckName, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(check, Verdict::Fault, found, remedy)
    }

    fn new(check: CheckName, verdict: Verdict, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { check, device: String::new(), verdict, found: found.into(), remedy: remedy.into() }
    }

    /// Of this device.
    pub(crate) fn of(self, device: &str) -> Self {
        Self { device: device.to_owned(), ..self }
    }
}

/// The gravest verdict.
#[must_use]
pub fn worst(checks: &[Check]) -> Verdict {
    checks.iter().map(|check| check.verdict).max().unwrap_or(Verdict::NotTested)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_the_names_that_people_read() {
        for name in CheckName::ALL {
            assert_eq!(serde_json::to_value(name).unwrap(), name.name());
        }
        for verdict in [Verdict::NotTested, Verdict::Ok, Verdict::Warning, Verdict::Fault] {
            assert_eq!(serde_json::to_value(verdict).unwrap(), verdict.name());
        }
        let names: std::collections::BTreeSet<_> = CheckName::ALL.into_iter().collect();
        assert_eq!(names.len(), CheckName::ALL.len());
    }

    #[test]
    fn what_was_not_tested_is_no_better_than_what_is_right() {
        let checks = [Check::not_tested(CheckName::Data, "no device"), Check::ok(CheckName::Opened, "opened")];
        assert_eq!((worst(&checks), worst(&[])), (Verdict::Ok, Verdict::NotTested));
        assert!(Verdict::Fault > Verdict::Warning && Verdict::Warning > Verdict::Ok);
    }
}
