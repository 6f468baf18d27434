//! The strobe of a camera at the trigger input of an event camera: a pulse for each exposure, as long as that.

use erfgs_recorder::DeviceSettings;
use erfgs_session::trigger::code::SensedPulse;
use erfgs_sync::{is_strobe, pulses};

use super::{DeviceFindings, Findings, Subject};
use crate::{
    check::{Check, CheckName},
    observe::Observed,
};

const STROBE: CheckName = CheckName::StrobeEdges;
/// Devices start and stop one after the other: at the ends of a recording frames or edges may be cut off, so many, those of so many
/// seconds, and half of all at most.
const CUT_OFF: u64 = 3;
const CUT_OFF_S: f64 = 0.4;

/// The output that shows the exposure of a camera, if the rig names one.
fn line(entry: &DeviceFindings) -> Option<&str> {
    #[cfg(target_os = "linux")]
    if let DeviceSettings::Camera(config) = &entry.device.settings {
        return config.genicam.as_ref().map(|more| more.strobe_line.as_str()).filter(|line| !line.is_empty());
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (entry, |settings: &DeviceSettings| matches!(settings, DeviceSettings::Camera(_)));
    None
}

/// The camera whose strobe the trigger input of an event camera has, if it has one.
pub fn camera_of<'a>(findings: &'a Findings, event_camera: &str) -> Option<&'a str> {
    let recording = findings.together.recording()?;
    let eye = recording.stream(event_camera)?;
    let cameras = findings.devices.iter().filter(|entry| line(entry).is_some());
    let ids = cameras.map(|entry| entry.device.id.as_str());
    ids.into_iter().find(|id| recording.stream(id).is_some_and(|camera| shows(eye, camera).is_some()))
}

/// How many strobes an event camera saw, if its edges are those of a camera's exposures.
fn shows(eye: &Observed, camera: &Observed) -> Option<u64> {
    let edges = &eye.events.as_ref()?.edges;
    let exposure_ns = camera.description.exposure_ns()?;
    let strobes = pulses(edges, edges.first()?.channel);
    let is_one = |pulse: &SensedPulse| pulse.width_ns.is_none_or(|width_ns| is_strobe(width_ns, exposure_ns));
    let (count, frames) = (strobes.len() as u64, camera.totals.packets + camera.missing_frames);
    let cut_off = CUT_OFF.max((CUT_OFF_S * camera.frames_per_s().unwrap_or(0.0)) as u64).min(frames / 2);
    let whole = strobes.iter().filter(|pulse| is_one(pulse)).count() as u64;
    (frames > 0 && count > 0 && whole + 1 >= count && count.abs_diff(frames) <= cut_off).then_some(count)
}

pub fn strobe_edges(subject: &Subject<'_>) -> Option<Check> {
    let line = line(subject.entry)?;
    let Some(recorded) = subject.together() else {
        return Some(Check::not_tested(STROBE, "it was not recorded with the others"));
    };
    let camera = recorded.observed;
    if camera.totals.packets == 0 {
        return Some(Check::not_tested(STROBE, "it gave no frame"));
    }
    if camera.description.exposure_ns().is_none() {
        return Some(Check::not_tested(STROBE, "its exposure is not known"));
    }
    let mut eyes = recorded.recording.streams.iter().filter(|stream| stream.events.is_some()).peekable();
    if eyes.peek().is_none() {
        return Some(Check::not_tested(STROBE, "the rig has no event camera that could see it"));
    }
    let frames = camera.totals.packets;
    let found = eyes.find_map(|eye| Some((eye.description.id.clone(), shows(eye, camera)?)));
    Some(match found {
        Some((eye, strobes)) => {
            Check::ok(STROBE, format!("{strobes} at the trigger input of '{eye}' for {frames} frames"))
        }
        None => Check::warning(
            STROBE,
            format!("no event camera has edges like its {frames} exposures"),
            format!("wire {line} to a trigger input, with ground; a camera's open output needs a pull-up resistor"),
        ),
    })
}
