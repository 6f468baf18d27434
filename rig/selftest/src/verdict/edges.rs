//! Pulses at the trigger inputs of event cameras.

use erfgs_events::Edge;
use erfgs_session::clock::{Evidence, Sample};
use erfgs_sync::{Board, Matched, fit_edges};
use serde_json::Value;

use super::{Recorded, Subject, strobe};
use crate::check::{Check, CheckName};

const EDGES: CheckName = CheckName::TriggerEdges;
/// The code on the pulses tells their numbers from 15 in a row; so many are given at least.
const FEWEST: usize = 16;
/// Edges of one board differ by the camera's microsecond and the board's tick. What is more comes from the wire, nanoseconds.
const SPREAD_NS: f64 = 20_000.0;
/// Pulses at the end of a recording that may still be on their way, nanoseconds.
const ON_THE_WAY_NS: i64 = 200_000_000;
const WIRE: &str = "check the wire from the board's D8 to the camera's trigger input, its ground and its voltage";

/// Which edges a camera is set to tell: those that rise and those that fall. `None` if it is no event camera.
fn listens(settings: &serde_json::Map<String, Value>) -> Option<[bool; 2]> {
    if let Some(input) = settings.get("external_input") {
        return Some(["rising", "falling"].map(|edge| input.get(edge).and_then(Value::as_bool) == Some(true)));
    }
    settings.get("external_trigger").map(|on| [on.as_bool() == Some(true); 2])
}

pub fn trigger_edges(subject: &Subject<'_>) -> Option<Check> {
    if !subject.description.encoding.is_events() {
        return None;
    }
    let board = match subject.pulses.given(EDGES) {
        Ok(board) => board,
        Err(not_tested) => return Some(not_tested),
    };
    let Some(events) = subject.together().and_then(|recorded| recorded.observed.events.as_ref()) else {
        return Some(Check::not_tested(EDGES, "it was not recorded with the board"));
    };
    let Some([rising, falling]) = listens(&subject.description.settings) else {
        return Some(Check::not_tested(EDGES, "it has no trigger input"));
    };
    if !rising && !falling {
        return Some(Check::not_tested(EDGES, "its trigger input is switched off"));
    }
    let given = board.pulses.len();
    let [rises, falls] = events.edge_counts();
    if rises + falls == 0 {
        return Some(Check::fault(EDGES, format!("no edge arrived of {given} pulses"), WIRE));
    }
    if rising && falling && (rises == 0 || falls == 0) {
        let which = if rises == 0 { "no edge that rises" } else { "no edge that falls" };
        let found = format!("{rises} edges rise and {falls} fall: {which} arrived");
        return Some(Check::fault(EDGES, found, "the input's level is at its limit: check voltage and level shifter"));
    }
    if given < FEWEST {
        let why = format!("{given} pulses are too few to be numbered by their widths; test for longer (--seconds)");
        return Some(Check::not_tested(EDGES, why));
    }
    if rising != falling {
        let why = format!(
            "{} edges for {given} pulses; only one polarity is switched on, so that they have no numbers",
            rises + falls
        );
        return Some(Check::not_tested(EDGES, why));
    }
    match fit_edges(&events.edges, board) {
        Ok((clock, matched, samples)) if matched.matched > 0 => {
            let spread_ns = subject
                .together()
                .and_then(|recorded| spread_ns(recorded, &subject.entry.device.id))
                .unwrap_or(clock.residuals.p95_ns);
            Some(numbered(board, spread_ns, matched, &samples))
        }
        _ => Some(unnumbered(subject, &events.edges, board)),
    }
}

/// How far edges lie from where the camera's clock has them, nanoseconds: of the parts between jumps of the clock, the worst.
fn spread_ns(recorded: &Recorded<'_>, id: &str) -> Option<f64> {
    let clocks = recorded.recording.sync.stream(id)?.epochs.clocks();
    let by_edges = clocks.filter(|clock| clock.evidence() == Some(Evidence::TriggerEdges));
    by_edges.map(|clock| clock.residuals.p95_ns).max_by(f64::total_cmp)
}

/// Of edges that have the numbers of pulses.
fn numbered(board: &Board, spread_ns: f64, matched: Matched, samples: &[Sample]) -> Check {
    let last_ns = samples.iter().map(|sample| sample.session_ns).max().unwrap_or(0);
    let end_ns =
        board.pulses.values().map(|pulse| board.rise_ns(pulse)).max().unwrap_or(0).saturating_sub(ON_THE_WAY_NS);
    // From the first pulse on: a board starts when all cameras run.
    let expected = board.pulses.values().filter(|pulse| board.rise_ns(pulse) <= last_ns.max(end_ns)).count() as u64;
    let missing = expected.saturating_sub(matched.matched);
    let odd = matched.seen.saturating_sub(matched.matched);
    if missing > 0 || odd > 1 {
        let found = format!(
            "{missing} of {expected} pulses did not arrive, and {odd} of {} edges that rise have no number",
            matched.seen
        );
        return Check::fault(EDGES, found, format!("{WIRE}; a long wire without ground picks up edges of others"));
    }
    let found = format!("{} of {expected} pulses, within {:.1} µs (95 %)", matched.matched, spread_ns / 1e3);
    if spread_ns > SPREAD_NS {
        return Check::warning(
            EDGES,
            found,
            "edges are slow or noisy: shorten the wire, or use a buffer instead of a resistor",
        );
    }
    Check::ok(EDGES, found)
}

/// Of edges that have no numbers: upside down, of a strobe, or of something else.
fn unnumbered(subject: &Subject<'_>, edges: &[Edge], board: &Board) -> Check {
    let inverted: Vec<Edge> = edges.iter().map(|edge| Edge { rising: !edge.rising, ..*edge }).collect();
    if let Ok((_, matched, _)) = fit_edges(&inverted, board)
        && matched.matched > 0
    {
        let found = format!("the polarity is inverted: {} pulses arrive as gaps", matched.matched);
        return Check::fault(
            EDGES,
            found,
            "an inverting level shifter or opto-isolator is in the wire: swap it, or its wires",
        );
    }
    if let Some(camera) = strobe::camera_of(subject.findings, &subject.entry.device.id) {
        return Check::not_tested(
            EDGES,
            format!("its input has the strobe of '{camera}' instead of the board's pulses"),
        );
    }
    let found = format!("{} edges arrived, none of which is one of {} pulses", edges.len(), board.pulses.len());
    Check::fault(EDGES, found, WIRE)
}
