//! The trigger board: whether it answers, and gives its pulses.

use erfgs_session::source::Encoding;
use erfgs_sync::Bounds;

use super::Subject;
use crate::check::{Check, CheckName};

const ANSWERS: CheckName = CheckName::BoardAnswers;
const PULSES: CheckName = CheckName::Pulses;
/// Beyond this a board answers so late that its clock is badly known, nanoseconds.
const LATE_NS: f64 = 10e6;
/// A command and its answer take this long on the serial line together, nanoseconds.
const SERIAL_NS: f64 = 1.5e6;
/// A board starts after all cameras: it gives at least this share of the pulses of the whole recording.
const FEWEST: f64 = 0.3;
/// The period that the board tells is exact but for a tick.
const OFF_TICKS: f64 = 2.0;

fn is_board(subject: &Subject<'_>) -> bool {
    subject.description.encoding == Encoding::TriggerLines
}

pub fn answers(subject: &Subject<'_>) -> Option<Check> {
    let recorded = subject.together().filter(|_| is_board(subject))?;
    let Some(board) = recorded.observed.board.as_ref().and_then(|lines| lines.board.as_ref()) else {
        let found = "none of its lines has a time";
        return Some(Check::fault(ANSWERS, found, "press the board's reset button, or flash its firmware again"));
    };
    if board.resets > 0 {
        let remedy =
            "look at its power supply: the frame triggers of several cameras may take more than a USB port gives";
        return Some(Check::fault(ANSWERS, format!("it restarted {} times", board.resets), remedy));
    }
    Some(match board.bounds {
        Bounds::Within { half_ns } if half_ns > LATE_NS => {
            let found = format!("its clock is known to ± {:.1} ms", half_ns * 1e-6);
            Check::warning(ANSWERS, found, "plug it into the computer itself, and test with less else to do")
        }
        Bounds::Within { half_ns } => Check::ok(ANSWERS, format!("its clock is known to ± {:.0} µs", half_ns / 1e3)),
        // What is taken off for the serial line is too much where there is none: at a board with USB of its own.
        Bounds::Disagree { by_ns } if by_ns < SERIAL_NS => {
            Check::ok(ANSWERS, format!("its clock is known to ± {:.0} µs", by_ns / 1e3))
        }
        Bounds::Disagree { by_ns } => {
            let found = format!("commands and answers disagree by {:.0} µs", by_ns / 1e3);
            Check::warning(
                ANSWERS,
                found,
                "test again with less else to do; all triggered streams may share an unknown offset",
            )
        }
        Bounds::OneSided => {
            let remedy =
                "its line to the computer is silent in one direction: try another cable, or flash its firmware again";
            Check::fault(ANSWERS, "it answered no `clock` command", remedy)
        }
    })
}

pub fn pulses(subject: &Subject<'_>) -> Option<Check> {
    let recorded = subject.together().filter(|_| is_board(subject))?;
    let setting = |name: &str| recorded.observed.description.settings.get(name)?.as_f64();
    let (rate_hz, period) = (setting("rate_hz")?, setting("period_ticks")?);
    let board = recorded.observed.board.as_ref().and_then(|lines| lines.board.as_ref());
    let given = board.map_or(0, |board| board.pulses.len() as u64);
    let expected = rate_hz * recorded.recording.seconds;
    let Some(board) = board.filter(|_| given as f64 >= FEWEST * expected && given > 0) else {
        if expected < 2.0 {
            let why = format!("{given} pulses at {rate_hz:.2} Hz are too few; test for longer (--seconds)");
            return Some(Check::not_tested(PULSES, why));
        }
        let found = format!("{given} pulses; {expected:.0} were to come at {rate_hz:.2} Hz");
        return Some(Check::fault(PULSES, found, "press the board's reset button, or flash its firmware again"));
    };
    let ticks: Vec<(&u64, &u64)> = board.pulses.iter().map(|(index, pulse)| (index, &pulse.tick)).collect();
    let odd = ticks.windows(2).filter(|pair| {
        let steps = (pair[1].0 - pair[0].0) as f64;
        (pair[1].1.saturating_sub(*pair[0].1) as f64 - steps * period).abs() > OFF_TICKS * steps
    });
    let odd = odd.count();
    if odd > 0 {
        let found = format!("{odd} of {given} pulses came at another time than the period of {period:.0} ticks says");
        return Some(Check::fault(PULSES, found, "flash the board's firmware again"));
    }
    let index = |at: Option<&(&u64, &u64)>| at.map_or(0, |(index, _)| **index);
    let (first, last) = (index(ticks.first()), index(ticks.last()));
    let unheard = board.restored + first + (last - first + 1).saturating_sub(given);
    if unheard > 0 {
        let found = format!("the lines of {unheard} of {} pulses did not arrive", last + 1);
        return Some(Check::warning(PULSES, found, "use a shorter USB cable for the board, without a hub"));
    }
    Some(Check::ok(PULSES, format!("{given} at {rate_hz:.2} Hz")))
}
