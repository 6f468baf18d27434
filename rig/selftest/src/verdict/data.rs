//! Whether data comes, can be decoded, and is whole.

use erfgs_session::source::{Encoding, Incident};

use super::{Alone, Recorded, Subject, Together};
use crate::check::{Check, CheckName};

const DATA: CheckName = CheckName::Data;
const FORMAT: CheckName = CheckName::Format;
const LOSSES: CheckName = CheckName::Losses;
/// A stream that is silent for longer has paused, or ended, seconds. A host that is busy may read so late, too.
const PAUSE_S: f64 = 0.5;
/// A stream of frames is silent for so many periods before that counts.
const PERIODS: f64 = 6.0;
/// Events before the first time or row of a stream, which began before it was listened to, and behind each break: a row's.
const USUAL_AT_BEGIN: u64 = 2000;
/// If so large a share of all items cannot be right, it is not a damaged word but another order of them.
const OTHER_ORDER: f64 = 0.05;
const ON_THE_WAY: &str =
    "use a shorter cable without a hub; spread cameras over more USB controllers or networks, or lower their rates";
/// Events enough to expect both polarities.
const BOTH_POLARITIES: u64 = 1000;

/// A device that does not start, or cannot because another one does not.
pub fn started(subject: &Subject<'_>) -> Option<Check> {
    let id = &subject.entry.device.id;
    let not_started = |reason: &str| {
        Check::fault(
            DATA,
            format!("does not start: {reason}"),
            "unplug it and plug it in again; if that does not help, see the guide",
        )
    };
    if let Alone::NotStarted(reason) = &subject.entry.alone {
        return Some(not_started(reason));
    }
    match &subject.findings.together {
        Together::NotStarted { device, reason } if device == id => Some(not_started(reason)),
        Together::NotStarted { device, .. } if subject.recordings.is_empty() => {
            Some(Check::not_tested(DATA, format!("'{device}' did not start, so that nothing was recorded")))
        }
        _ if subject.recordings.is_empty() => Some(Check::not_tested(DATA, "it was not recorded")),
        _ => None,
    }
}

/// How often something comes at least, seconds; `None` where nothing can be expected.
fn period_s(subject: &Subject<'_>) -> Option<f64> {
    let rate = |name: &str| subject.description.settings.get(name)?.as_f64().filter(|hz| *hz > 0.0);
    match subject.description.encoding {
        // Pulses decide.
        _ if subject.description.is_triggered() => None,
        Encoding::TriggerLines => Some(1.0 / rate("rate_hz")?),
        encoding if encoding.is_events() => Some(0.0),
        _ => Some(1.0 / rate("rate_hz").or(rate("asked_rate_hz"))?),
    }
}

pub fn data(subject: &Subject<'_>, recorded: &Recorded<'_>) -> Option<Check> {
    let Recorded { recording, observed, .. } = recorded;
    let packets = observed.totals.packets;
    let lost = observed.incidents.iter().find_map(|incident| match incident {
        Incident::Lost { reason } => Some(reason),
        _ => None,
    });
    if let Some(reason) = lost {
        return Some(Check::fault(DATA, format!("the device was lost: {reason}"), "check cable, hub and power supply"));
    }
    if packets == 0 {
        if subject.description.is_triggered() {
            return Some(Check::not_tested(DATA, "it waits for pulses: see frame-per-pulse"));
        }
        let found = format!("nothing came in {:.1} s", recording.seconds);
        return Some(Check::fault(DATA, found, "check the cable, then unplug the device and plug it in again"));
    }
    let ok = || Some(Check::ok(DATA, format!("{packets} packets, {}", bytes(observed.totals.bytes as f64))));
    let Some(period_s) = period_s(subject) else { return ok() };
    let longest_s = PAUSE_S.max(PERIODS * period_s);
    let last_s = observed.arrivals_ns.last().map_or(0.0, |&ns| ns as f64 * 1e-9);
    let silent_s = recording.seconds - last_s;
    if silent_s > longest_s {
        let found = format!("nothing came in the last {silent_s:.1} of {:.1} s", recording.seconds);
        return Some(Check::fault(DATA, found, "unplug the device and plug it in again; try another cable and port"));
    }
    let pause_s = observed.packet_intervals().longest_us * 1e-6;
    if pause_s > longest_s {
        let found = format!("nothing came for {pause_s:.1} s in between");
        let remedy = "close other programs and test again; if it stays, try another cable, port or hub";
        return Some(Check::warning(DATA, found, remedy));
    }
    ok()
}

pub fn format(subject: &Subject<'_>, recorded: &Recorded<'_>) -> Option<Check> {
    let observed = recorded.observed;
    if observed.totals.packets == 0 {
        return Some(Check::not_tested(FORMAT, "nothing came"));
    }
    let name = subject.description.encoding.name();
    if let Some(board) = &observed.board {
        let found = format!("{} damaged lines", board.damaged_lines);
        return Some(if board.damaged_lines > 0 {
            Check::warning(FORMAT, found, "shorten the board's USB cable; keep it away from motors and lamps")
        } else {
            Check::ok(FORMAT, "all lines have their checksum")
        });
    }
    if observed.is_frames() {
        return Some(match &observed.frame_problem {
            Some(problem) => {
                Check::fault(FORMAT, format!("a frame of {name} cannot be decoded: {problem}"), other_format())
            }
            None if observed.frames_ns.len() as u64 == observed.totals.damaged => {
                Check::not_tested(FORMAT, "no frame is whole")
            }
            None => Check::ok(FORMAT, format!("{name}, decoded")),
        });
    }
    let Some(events) = &observed.events else {
        return Some(Check::not_tested(FORMAT, format!("{name} is not decoded")));
    };
    let anomalies = events.anomalies;
    let at_begin = anomalies.undated + anomalies.no_row + anomalies.no_base;
    let wrong =
        anomalies.outside + anomalies.unknown + anomalies.incomplete + anomalies.damaged + anomalies.truncated_bytes;
    let begins = observed.totals.discontinuities.saturating_add(1);
    let wrong = wrong + if at_begin > USUAL_AT_BEGIN.saturating_mul(begins) { at_begin } else { 0 };
    let items = events.events + events.edges.len() as u64 + events.imu_samples;
    if wrong as f64 > OTHER_ORDER * (items + wrong) as f64 {
        let found = format!(
            "{anomalies} beside {items} that can be right: bytes are missing, or the order of words is not that of {name}"
        );
        let remedy = "try another cable, without a hub; if it stays, send this report to the developers";
        return Some(Check::fault(FORMAT, found, remedy));
    }
    if wrong > 0 {
        let found = format!("{anomalies} of {items}: words are damaged or missing");
        return Some(Check::fault(FORMAT, found, "try another cable, without a hub"));
    }
    if items == 0 {
        let why = "the stream has times and no event: move something before the lens, and take off its cap";
        return Some(Check::not_tested(FORMAT, why));
    }
    if events.events > BOTH_POLARITIES && (events.on == 0 || events.on == events.events) {
        let which = if events.on == 0 { "darker" } else { "brighter" };
        let found = format!("all {} events are {which}", events.events);
        return Some(Check::warning(
            FORMAT,
            found,
            "look at the biases diff_on and diff_off; move something before the lens",
        ));
    }
    Some(Check::ok(FORMAT, format!("{name}: {} events, {} edges", events.events, events.edges.len())))
}

fn other_format() -> &'static str {
    "send this report to the developers; meanwhile set another format, if the device has one"
}

pub fn losses(subject: &Subject<'_>, recorded: &Recorded<'_>) -> Option<Check> {
    let observed = recorded.observed;
    if observed.totals.packets == 0 {
        return None;
    }
    let (totals, counters) = (&observed.totals, &observed.counters);
    let dropped = |stage: &str| observed.dropped.get(stage).copied().unwrap_or(0);
    let before_us = [
        (counters.lost, "lost before they reached the program"),
        (observed.missing_frames, "frames that were counted and did not come"),
        (totals.discontinuities, "breaks in the stream"),
        (totals.damaged, "damaged frames"),
        (counters.reconnections, "reconnections"),
    ];
    let after = [
        (dropped("queue"), "dropped, as the disk was too slow"),
        (dropped("writer"), "not written"),
        (totals.missing.saturating_sub(dropped("queue") + dropped("writer")), "missing in the numbering"),
    ];
    let list = |of: &[(u64, &str)]| {
        of.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect::<Vec<_>>()
    };
    let (on_the_way, here) = (list(&before_us), list(&after));
    if on_the_way.is_empty() && here.is_empty() {
        // What was asked for again and then came twice was late, not lost.
        let reading = |name: &str| subject.entry.readings.get(name).copied().unwrap_or(0.0);
        let again = reading("asked_packets") - reading("doubled_packets") - reading("late_packets");
        if again > 0.0 {
            let found = format!("{again:.0} packets were lost on the network, and came when they were asked for again");
            return Some(Check::warning(
                LOSSES,
                found,
                "larger receive buffers (net.core.rmem_max), a switch without other traffic, or lower rates",
            ));
        }
        if let Some((holes, longest_us)) =
            observed.events.as_ref().and_then(|events| events.holes.count()).filter(|(holes, _)| *holes > 0)
        {
            let found =
                format!("{holes} holes of up to {:.1} ms between packets of dense events", longest_us as f64 * 1e-3);
            return Some(Check::warning(LOSSES, found, ON_THE_WAY));
        }
        return Some(Check::ok(LOSSES, format!("none of {} packets", totals.packets)));
    }
    let remedy = match (on_the_way.is_empty(), here.is_empty()) {
        (true, _) => "record to a faster disk; test with TMPDIR or --keep on the disk of your recordings",
        (_, true) => ON_THE_WAY,
        _ => "first lower the rates of the cameras until nothing is dropped, then look at cables",
    };
    Some(Check::fault(LOSSES, [on_the_way, here].concat().join(", "), remedy))
}

/// `12.3 MB`.
pub fn bytes(count: f64) -> String {
    if count < 1e3 {
        format!("{count:.0} B")
    } else if count < 1e6 {
        format!("{:.1} kB", count * 1e-3)
    } else {
        format!("{:.1} MB", count * 1e-6)
    }
}
