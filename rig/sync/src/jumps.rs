//! Jumps of an event camera's clock that the camera says nothing of: between two edges it counts more or less than passed between
//! the board's pulses.
//!
//! The edges tell that the clock jumped and by how much, and between which two of them; the arrivals of packets tell in which
//! packet. What comes before it and what comes from it on are stretches of their own, as after a break that was told.

use erfgs_session::clock::Sample;

use super::{board::Board, edges, events::Stretch};

/// What a camera counts and what passes differ by so much at most where nothing jumps: jitter of an edge, nanoseconds, and the error
/// of a crystal, as a share of the time between two edges.
const JITTER_NS: f64 = 100_000.0;
const RATE: f64 = 5e-4;
/// A clock that jumped stays there: an edge alone that does not fit was taken for another.
const FEWEST: usize = 2;

/// A stretch, in parts between which its clock jumps.
pub(super) fn split(stretch: Stretch, board: Option<&Board>) -> Vec<Stretch> {
    let Some(board) = board else { return vec![stretch] };
    let (known, _) = edges::read(&stretch.edges, board);
    let mut parts = Vec::new();
    let mut rest = stretch;
    for [last, first] in jumps(&known) {
        let Some(sequence) = packet(&rest, last, first) else { continue };
        let (before, after) = rest.cut(sequence);
        parts.push(before);
        rest = after;
    }
    parts.push(rest);
    parts
}

/// How far session time is ahead of what the camera counted.
fn ahead_ns(sample: &Sample) -> f64 {
    sample.session_ns as f64 - edges::NS_PER_TICK * sample.ticks as f64
}

fn agree(a: &Sample, b: &Sample) -> bool {
    let apart_ns = a.session_ns.abs_diff(b.session_ns) as f64;
    (ahead_ns(a) - ahead_ns(b)).abs() <= JITTER_NS + RATE * apart_ns
}

/// The last edge before each jump, and the first after it.
fn jumps(known: &[Sample]) -> Vec<[Sample; 2]> {
    let mut found = Vec::new();
    let mut last: Option<Sample> = None;
    for run in known.chunk_by(agree).filter(|run| run.len() >= FEWEST) {
        if let Some(last) = last.filter(|last| !agree(last, &run[0])) {
            found.push([last, run[0]]);
        }
        last = run.last().copied();
    }
    found
}

/// The packet from which on arrivals fit the clock after a jump better than the one before it.
fn packet(stretch: &Stretch, last: Sample, first: Sample) -> Option<u64> {
    let between =
        |at: &&(u64, Sample)| (last.ticks.min(first.ticks)..=last.ticks.max(first.ticks)).contains(&at.1.ticks);
    let delays = |clock: Sample| {
        let late = stretch.arrivals.iter().map(move |(_, arrival)| ahead_ns(arrival) - ahead_ns(&clock));
        late.filter(|late| *late >= 0.0).fold(f64::INFINITY, f64::min)
    };
    // Both clocks see the same least delay, which the better half of them tells: that of the earlier clock where time jumped ahead.
    let least = delays(if ahead_ns(&first) < ahead_ns(&last) { first } else { last });
    let off = |arrival: &Sample, clock: &Sample| (ahead_ns(arrival) - ahead_ns(clock) - least).abs();
    // The arrivals around the jump, by when they came.
    let since = last.session_ns..=first.session_ns.saturating_add(least.clamp(0.0, 1e9) as i64);
    let around: Vec<&(u64, Sample)> =
        stretch.arrivals.iter().filter(|at| between(at) || since.contains(&at.1.session_ns)).collect();
    let cost = |place: usize| {
        let (before, after) = around.split_at(place);
        before.iter().map(|at| off(&at.1, &last)).sum::<f64>() + after.iter().map(|at| off(&at.1, &first)).sum::<f64>()
    };
    let place = (0..around.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b)))?;
    let sequence = around[place].0;
    (sequence > stretch.place.0).then_some(sequence)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(n: i64, jumped_us: i64) -> Sample {
        // 30 ppm fast.
        Sample { ticks: 7_000 + n * 50_001 + n / 2 + jumped_us, session_ns: n * 50_000_000 }
    }

    #[test]
    fn a_clock_that_stays_ahead_jumped_and_an_edge_alone_did_not() {
        let whole: Vec<Sample> = (0..40).map(|n| sample(n, if n < 25 { 0 } else { 900 })).collect();
        assert_eq!(jumps(&whole), [[whole[24], whole[25]]]);
        let back: Vec<Sample> = (0..40).map(|n| sample(n, if n < 25 { 0 } else { -20_000 })).collect();
        assert_eq!(jumps(&back).len(), 1);
        let mut wrong: Vec<Sample> = (0..40).map(|n| sample(n, 0)).collect();
        wrong[12] = sample(12, 20_000);
        assert!(jumps(&wrong).is_empty());
        assert!(jumps(&[]).is_empty());
    }
}
