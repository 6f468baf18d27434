//! The clocks of an event camera: one for each stretch between breaks, by the edges in it or by the arrivals.
//!
//! Not every break is a new time. Where data was lost on the way, the device's clock went on: if a stretch lies where the
//! clock before it says, and its edges agree, both are one epoch, so that lost packets do not make a good clock worse.

use erfgs_events::Edge;
use erfgs_events::EventEncoding;
use erfgs_session::{
    clock::{Clock, Epoch, Sample},
    source::Encoding,
};

use super::{
    board::Board,
    edges::{self, Matched},
    events::Stretch,
    jumps,
    lamp::Counts,
};

/// Arrivals of a stretch whose clock went on lie so much earlier or later at most than those before, nanoseconds. It may
/// be short, and its packets all late.
const ARRIVALS_NS: std::ops::Range<f64> = -500_000.0..5_000_000.0;
/// Two clocks by edges are one if they agree to this, and to what rates change by over a gap.
const EDGES_NS: f64 = 25_000.0;
const EDGES_PPM: f64 = 3.0;

/// An epoch, and what it rests on.
pub(super) struct Fitted {
    pub epoch: Epoch,
    pub edges: Vec<Edge>,
    /// How the edges matched the board's pulses, if there is a board.
    pub matched: Option<Matched>,
    /// Rising edges of known pulses; none if the clock rests on arrivals.
    known: Vec<Sample>,
    arrivals: Vec<Sample>,
    /// The least delay of the arrivals by the clock, nanoseconds.
    delay_ns: f64,
    /// Samples at the last fit.
    fitted: usize,
    /// Counts of events, where a lamp is looked for.
    pub counts: Vec<Counts>,
}

/// Fits the stretches of a stream.
pub(super) fn fit(stretches: Vec<Stretch>, encoding: Encoding, board: Option<&Board>) -> Vec<Fitted> {
    let mut epochs: Vec<Fitted> = Vec::new();
    for stretch in stretches.into_iter().flat_map(|stretch| jumps::split(stretch, board)) {
        let next = Fitted::new(stretch, board);
        match epochs.last_mut() {
            Some(last) if last.goes_on_in(&next, encoding) => last.take(next),
            _ => {
                epochs.iter_mut().last().into_iter().for_each(Fitted::fit);
                epochs.push(next);
            }
        }
    }
    epochs.iter_mut().last().into_iter().for_each(Fitted::fit);
    epochs
}

impl Fitted {
    fn new(stretch: Stretch, board: Option<&Board>) -> Self {
        let Stretch { place: (first_sequence, first_break), arrived_ns, edges, arrivals, counts, .. } = stretch;
        let (known, matched) = board.map(|board| edges::read(&edges, board)).unzip();
        let mut fitted = Self {
            epoch: Epoch { first_sequence, first_break, arrived_ns, clock: None },
            edges,
            matched,
            known: known.unwrap_or_default(),
            arrivals: arrivals.into_iter().map(|(_, arrival)| arrival).collect(),
            delay_ns: 0.0,
            fitted: 0,
            counts: counts.into_iter().collect(),
        };
        fitted.fit();
        fitted
    }

    /// Fits the clock, if samples came since the last time.
    fn fit(&mut self) {
        if self.fitted == self.samples() {
            return;
        }
        self.fitted = self.samples();
        self.epoch.clock = edges::fit_matched(&self.known).or_else(|_| edges::fit_arrivals(&self.arrivals)).ok();
        self.delay_ns = self.epoch.clock.as_ref().map_or(0.0, |clock| delay_ns(clock, &self.arrivals));
    }

    /// Fits the clock to edges whose times are known otherwise.
    pub fn tie(&mut self, known: Vec<Sample>) {
        self.known = known;
        self.fit();
    }

    fn samples(&self) -> usize {
        self.known.len() + self.arrivals.len()
    }

    /// What the clock was fitted to.
    pub fn evidence(&self) -> &[Sample] {
        if self.known.is_empty() { &self.arrivals } else { &self.known }
    }

    /// Whether the device's clock went on over the break before `next`.
    fn goes_on_in(&self, next: &Self, encoding: Encoding) -> bool {
        let (Some(clock), Some(of_next)) = (&self.epoch.clock, &next.epoch.clock) else { return false };
        let (Some(last), Some(first)) = (self.arrivals.last(), next.arrivals.first()) else { return false };
        if first.ticks < last.ticks {
            return false;
        }
        // Edges date a clock better than arrivals, wherever they are.
        let (known, other) = if next.known.len() > self.known.len() { (next, self) } else { (self, next) };
        let Some(known_clock) = &known.epoch.clock else { return false };
        if !ARRIVALS_NS.contains(&(delay_ns(known_clock, &other.arrivals) - known.delay_ns)) {
            return false;
        }
        if self.known.is_empty() || next.known.is_empty() {
            // A DAVIS tells its time modulo 33 ms after a gap, which too often fits by chance.
            return encoding != Encoding::Events(EventEncoding::Davis);
        }
        let gap_ns = first.session_ns.saturating_sub(last.session_ns) as f64;
        let limit = EDGES_NS + gap_ns.max(0.0) * EDGES_PPM * 1e-6;
        [last.ticks, first.ticks]
            .into_iter()
            .all(|ticks| (clock.session_ns(ticks).saturating_sub(of_next.session_ns(ticks)) as f64).abs() < limit)
    }

    /// Takes a stretch into the epoch. The clock is fitted anew when there is twice as much to fit, and at the end.
    fn take(&mut self, next: Self) {
        let first_edges = self.known.is_empty() && !next.known.is_empty();
        self.edges.extend(next.edges);
        self.matched = match (self.matched, next.matched) {
            (Some(ours), Some(theirs)) => Some(ours.and(theirs)),
            (ours, theirs) => ours.or(theirs),
        };
        self.known.extend(next.known);
        self.arrivals.extend(next.arrivals);
        self.counts.extend(next.counts);
        if first_edges || self.samples() > 2 * self.fitted {
            self.fit();
        }
    }
}

fn delay_ns(clock: &Clock, arrivals: &[Sample]) -> f64 {
    arrivals.iter().map(|sample| clock.distance_ns(sample)).fold(f64::INFINITY, f64::min)
}
