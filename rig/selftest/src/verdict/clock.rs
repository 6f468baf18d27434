//! The clock of a device: its rate, its steps, and where it begins.

use erfgs_session::{
    clock::{CRYSTAL_PPM, RESONATOR_PPM},
    source::StampClock,
};
use serde_json::Value;

use super::{Recorded, Subject};
use crate::{
    check::{Check, CheckName},
    rate::RateFit,
};

const RATE: CheckName = CheckName::ClockRate;
const STEPS: CheckName = CheckName::ClockSteps;
const RESET: CheckName = CheckName::ClockReset;
/// Crystals are better than this by far, parts per million.
const GOOD_PPM: f64 = 400.0;
/// A rate that is known no better tells nothing, parts per million.
const USELESS_PPM: f64 = 20_000.0;
/// A device that was set to zero may have run for so long before its first event, seconds.
const AFTER_RESET_S: f64 = 1.0;

pub fn rate(_: &Subject<'_>, recorded: &Recorded<'_>) -> Option<Check> {
    let observed = recorded.observed;
    if observed.totals.packets == 0 {
        return None;
    }
    if observed.is_frames() && observed.stamped_by != Some(StampClock::Camera) {
        let by = match observed.stamped_by {
            Some(StampClock::Monotonic) => "frames are stamped by the host's clock",
            _ => "frames have no stamps of the camera's clock",
        };
        return Some(Check::not_tested(RATE, by));
    }
    let too_few = || Some(Check::not_tested(RATE, "too little came to tell; test for longer (--seconds)"));
    let rate = match observed.clock {
        None | Some(RateFit::TooFew) => return too_few(),
        Some(RateFit::Stepped { .. }) => return Some(Check::not_tested(RATE, "the clock jumped: see clock-steps")),
        Some(RateFit::Even(rate)) => rate,
    };
    let found = format!("{:+.0} ± {:.0} ppm against this host's clock", rate.ppm, rate.uncertainty_ppm);
    let certain_ppm = rate.ppm.abs() - rate.uncertainty_ppm;
    let is_board = observed.board.is_some();
    Some(if certain_ppm > if is_board { RESONATOR_PPM } else { CRYSTAL_PPM } {
        let remedy = "the device's ticks are not what its driver takes them for: send this report to the developers";
        Check::fault(RATE, found, remedy)
    } else if is_board && certain_ppm > CRYSTAL_PPM {
        let remedy = "the board has a ceramic resonator, which `erfgs sync` follows; take one with a crystal where frames must come evenly";
        Check::warning(RATE, found, remedy)
    } else if certain_ppm > GOOD_PPM {
        Check::warning(RATE, found, "test for longer (--seconds 20); a crystal is within 100 ppm")
    } else if rate.uncertainty_ppm > USELESS_PPM {
        Check::not_tested(RATE, format!("{found}: too noisy to tell; test for longer (--seconds)"))
    } else {
        Check::ok(RATE, found)
    })
}

pub fn steps(subject: &Subject<'_>, recorded: &Recorded<'_>) -> Option<Check> {
    let observed = recorded.observed;
    let events = observed.events.as_ref();
    let remedy = "look at the cable of the synchronisation chain, if there is one; send this report to the developers";
    if let Some(RateFit::Stepped { by_ns }) = observed.clock {
        return Some(Check::fault(STEPS, format!("the clock jumped by {:+.1} ms", by_ns * 1e-6), remedy));
    }
    if let Some(events) = events {
        let back = events.anomalies.time_backward;
        if events.unexplained_breaks > 0 {
            let found = format!("the clock broke off {} times, and the driver lost nothing", events.unexplained_breaks);
            return Some(Check::fault(STEPS, found, remedy));
        }
        if back > 0 {
            return Some(Check::warning(STEPS, format!("{back} time words went back and were not confirmed"), remedy));
        }
    }
    // Against the board's pulses smaller jumps show, which split the stream into parts.
    let sync = recorded.recording.sync.stream(&subject.entry.device.id);
    let parts = sync.map_or(0, |sync| sync.epochs.as_slice().len()) as u64;
    if parts > 1 + observed.totals.discontinuities && events.is_some() {
        let found = format!("the clock jumped {} times against the pulses of the trigger board", parts - 1);
        return Some(Check::fault(STEPS, found, remedy));
    }
    if observed.is_frames() && observed.stamped_by == Some(StampClock::Camera) {
        let back = observed.frames_ns.windows(2).filter(|pair| pair[1] < pair[0]).count() as u64;
        if back > observed.totals.discontinuities {
            return Some(Check::fault(STEPS, format!("{back} stamps of the camera go back"), remedy));
        }
    }
    match observed.clock {
        None => None,
        Some(RateFit::TooFew) => Some(Check::not_tested(STEPS, "too little came to tell")),
        Some(_) => Some(Check::ok(STEPS, "it goes on without a step")),
    }
}

pub fn reset(subject: &Subject<'_>, recorded: &Recorded<'_>) -> Option<Check> {
    let observed = recorded.observed;
    let events = observed.events.as_ref()?;
    let setting = |name: &str| subject.description.settings.get(name);
    if setting("timestamps").and_then(Value::as_str) == Some("keep") {
        return Some(Check::not_tested(RESET, "the rig asks that it goes on (timestamps = \"keep\")"));
    }
    if setting("sync").is_some_and(|role| role == "slave") || setting("clock_master").is_some_and(|is| is == false) {
        return Some(Check::not_tested(RESET, "another camera sets its clock"));
    }
    let [first_us, _] = events.range_us?;
    let begin_s = first_us as f64 * 1e-6;
    // The recording begins before the device is started.
    let most_s = observed.arrivals_ns.first().map_or(0.0, |&ns| ns as f64 * 1e-9) + AFTER_RESET_S;
    Some(if begin_s > most_s {
        let found = format!("its clock begins at {begin_s:.3} s, and was not set to zero at the start");
        Check::warning(RESET, found, "recordings can be used; send this report to the developers")
    } else {
        Check::ok(RESET, format!("it begins at {begin_s:.3} s"))
    })
}
