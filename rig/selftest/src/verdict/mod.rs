//! From what was found to a verdict on each check.

mod board;
mod clock;
mod data;
mod edges;
mod frames;
mod load;
mod opened;
mod strobe;
mod temperature;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use erfgs_recorder::{DeviceConfig, DeviceSettings};
use erfgs_session::source::Description;
use erfgs_sync::Board;

use crate::{
    check::{Check, CheckName, Verdict},
    observe::{Observed, Recording},
};

/// What was found of a rig.
#[derive(Debug)]
pub struct Findings {
    /// Of each device, in the order of the rig.
    pub devices: Vec<DeviceFindings>,
    /// The recording of all.
    pub together: Together,
}

/// What was found of a device.
#[derive(Debug)]
pub struct DeviceFindings {
    /// What the rig asks for.
    pub device: DeviceConfig,
    /// What it is, or why it cannot be opened.
    pub opened: Result<Description, String>,
    /// Its recording without the others.
    pub alone: Alone,
    /// What its driver warned of.
    pub warnings: Vec<String>,
    /// What it measured of itself.
    pub readings: BTreeMap<String, f64>,
}

/// A recording of one device.
#[derive(Debug)]
pub enum Alone {
    /// It was made.
    Recorded(Box<Recording>),
    /// The device did not start.
    NotStarted(String),
    /// It was not made, for this reason.
    Skipped(String),
}

/// The recording of all devices that can be opened and started.
#[derive(Debug)]
pub enum Together {
    /// It was made.
    Recorded(Box<Recording>),
    /// A device did not start.
    NotStarted {
        /// Which.
        device: String,
        /// What its driver says.
        reason: String,
    },
    /// No device is there to be recorded.
    NotMade,
}

impl Together {
    fn recording(&self) -> Option<&Recording> {
        if let Self::Recorded(recording) = self { Some(recording) } else { None }
    }
}

/// A device in a recording.
struct Recorded<'a> {
    recording: &'a Recording,
    observed: &'a Observed,
    /// Whether no other device was recorded.
    alone: bool,
}

/// A device that was opened, and the rig around it.
struct Subject<'a> {
    entry: &'a DeviceFindings,
    description: &'a Description,
    /// What it sent: alone, unless it waits for a trigger, and with all others.
    recordings: Vec<Recorded<'a>>,
    findings: &'a Findings,
    /// The pulses of the rig's trigger board.
    pulses: &'a Pulses<'a>,
}

impl<'a> Subject<'a> {
    fn together(&self) -> Option<&Recorded<'a>> {
        self.recordings.iter().find(|recorded| !recorded.alone)
    }

    fn alone(&self) -> Option<&Recorded<'a>> {
        self.recordings.iter().find(|recorded| recorded.alone)
    }
}

/// What is known of the trigger board of a rig.
enum Pulses<'a> {
    /// The rig has none.
    NoBoard,
    /// It has one, which gave none.
    None,
    /// It gave these.
    Given(&'a Board),
}

impl<'a> Pulses<'a> {
    fn of(findings: &'a Findings) -> Self {
        let is_board = |entry: &&DeviceFindings| matches!(entry.device.settings, DeviceSettings::Trigger(_));
        let Some(board) = findings.devices.iter().find(is_board) else { return Self::NoBoard };
        let observed = findings.together.recording().and_then(|recording| recording.stream(&board.device.id));
        let given = observed.and_then(|observed| observed.board.as_ref()?.board.as_ref());
        given.filter(|board| !board.pulses.is_empty()).map_or(Self::None, Self::Given)
    }

    /// The board that gave pulses, or why a check of them cannot be made.
    fn given(&self, check: CheckName) -> Result<&'a Board, Check> {
        match self {
            Self::Given(board) => Ok(board),
            Self::NoBoard => Err(Check::not_tested(check, "the rig has no trigger board")),
            Self::None => Err(Check::not_tested(check, "the trigger board gave no pulse")),
        }
    }
}

/// Judges a rig: check by check of each device, in the order of the rig, then what concerns all.
#[must_use]
pub fn judge(findings: &Findings) -> Vec<Check> {
    let pulses = Pulses::of(findings);
    let mut checks = Vec::new();
    for entry in &findings.devices {
        let of_device = match &entry.opened {
            Ok(description) => of_device(&subject_of(entry, description, findings, &pulses)),
            Err(reason) => vec![opened::refused(reason)],
        };
        checks.extend(of_device.into_iter().map(|check| check.of(&entry.device.id)));
    }
    if let Pulses::NoBoard = pulses {
        checks.extend(
            [CheckName::BoardAnswers, CheckName::Pulses]
                .map(|check| Check::not_tested(check, "the rig has no trigger board")),
        );
    }
    checks
}

fn subject_of<'a>(
    entry: &'a DeviceFindings,
    description: &'a Description,
    findings: &'a Findings,
    pulses: &'a Pulses<'a>,
) -> Subject<'a> {
    let id = entry.device.id.as_str();
    let recorded =
        |recording: &'a Recording, alone| Some(Recorded { recording, observed: recording.stream(id)?, alone });
    let alone = match &entry.alone {
        Alone::Recorded(recording) if !description.is_triggered() => recorded(recording, true),
        _ => None,
    };
    let together = findings.together.recording().and_then(|recording| recorded(recording, false));
    Subject { entry, description, recordings: alone.into_iter().chain(together).collect(), findings, pulses }
}

/// All checks of a device that could be opened, as far as they concern its kind.
fn of_device(subject: &Subject<'_>) -> Vec<Check> {
    let mut checks = vec![opened::opened(subject), opened::serial_number(subject), opened::settings(subject)];
    checks.push(opened::driver_warnings(subject));
    checks.extend(data::started(subject).or_else(|| gravest(subject, data::data)));
    checks.extend(gravest(subject, data::format));
    checks.extend(gravest(subject, data::losses));
    checks.extend(gravest(subject, clock::rate));
    checks.extend(gravest(subject, clock::steps));
    checks.extend(gravest(subject, clock::reset));
    checks.extend(gravest(subject, frames::rate));
    checks.extend(load::bandwidth(subject));
    checks.extend(frames::waits_for_trigger(subject));
    checks.extend(board::answers(subject));
    checks.extend(board::pulses(subject));
    checks.extend(edges::trigger_edges(subject));
    checks.extend(frames::frame_per_pulse(subject));
    checks.extend(strobe::strobe_edges(subject));
    checks.extend(temperature::temperature(subject));
    checks
}

/// The gravest verdict of a check on the recordings of a device; of equal ones that on the recording of all.
fn gravest(subject: &Subject<'_>, judge: fn(&Subject<'_>, &Recorded<'_>) -> Option<Check>) -> Option<Check> {
    let judged = subject.recordings.iter().filter_map(|recorded| Some((recorded.alone, judge(subject, recorded)?)));
    // Of equal ones the last.
    let (alone, check) = judged.max_by_key(|(_, check)| check.verdict)?;
    let at_odds = alone && check.verdict > Verdict::Ok && subject.together().is_some();
    Some(if at_odds { Check { found: format!("recorded alone: {}", check.found), ..check } } else { check })
}
