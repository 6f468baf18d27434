//! What a device sends beside the others, and alone.

use super::{Alone, Recorded, Subject, data::bytes};
use crate::{
    bus,
    check::{Check, CheckName},
};

const BANDWIDTH: CheckName = CheckName::Bandwidth;
/// Frames beside other devices are so much fewer than alone before that is a warning, as a share.
const FEWER_FRAMES: f64 = 0.05;
/// The rate of events depends on what moves before the lens: so much less may be chance.
const FEWER_EVENTS: f64 = 0.5;
/// Below this rate a bus is not what limits an event camera, bytes a second.
const LITTLE: f64 = 5e6;

pub fn bandwidth(subject: &Subject<'_>) -> Option<Check> {
    let together = subject.together()?;
    if together.observed.board.is_some() || together.observed.totals.packets == 0 {
        return None;
    }
    let rate = |recorded: &Recorded<'_>| recorded.observed.bytes_per_s().unwrap_or(0.0);
    let here = rate(together);
    let per_second = |rate: f64| format!("{}/s", bytes(rate));
    let Some(alone) = subject.alone() else {
        let why = match &subject.entry.alone {
            Alone::Skipped(why) => why.as_str(),
            Alone::Recorded(_) => "it waits for pulses",
            Alone::NotStarted(_) => "it did not start",
        };
        return Some(Check::not_tested(
            BANDWIDTH,
            format!("{} with all devices; alone it was not measured: {why}", per_second(here)),
        ));
    };
    let found = format!("{} alone, {} with all devices", per_second(rate(alone)), per_second(here));
    let fewer = match (alone.observed.frames_per_s(), together.observed.frames_per_s()) {
        (Some(alone), Some(together)) if subject.description.encoding.is_frames() => {
            together < (1.0 - FEWER_FRAMES) * alone
        }
        _ => rate(alone) > LITTLE && here < (1.0 - FEWER_EVENTS) * rate(alone),
    };
    if !fewer {
        return Some(Check::ok(BANDWIDTH, found));
    }
    let shared = sharers(subject);
    let with = match bus::of(subject.description) {
        Some(bus) if !shared.is_empty() => format!("; it shares {bus} with {}", shared.join(", ")),
        Some(bus) => format!("; it is alone on {bus}"),
        None => String::new(),
    };
    let remedy = "plug cameras into ports of other USB controllers or networks (`lsusb -t` shows which share one), or lower their rates";
    Some(Check::warning(BANDWIDTH, found + &with, remedy))
}

/// The devices on the same bus.
fn sharers<'a>(subject: &'a Subject<'_>) -> Vec<&'a str> {
    let bus = bus::of(subject.description);
    let others = subject.findings.devices.iter().filter(|other| other.device.id != subject.entry.device.id);
    let same = others.filter(|other| bus.is_some() && other.opened.as_ref().ok().and_then(bus::of) == bus);
    same.map(|other| other.device.id.as_str()).collect()
}
