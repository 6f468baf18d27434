//! The wire from a trigger board to the trigger inputs: every input that taps it sees the same edges at the same time.

use std::{
    collections::BTreeSet,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

/// An edge on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineEdge {
    /// True time, nanoseconds.
    pub at_ns: i64,
    /// Whether the level rises.
    pub rising: bool,
    /// Counts the pulses from 0; both edges of a pulse have its number.
    pub pulse: u64,
}

/// A train of equal pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PulseTrain {
    /// True time of the first rising edge, nanoseconds.
    pub first_ns: i64,
    /// From one rising edge to the next, nanoseconds.
    pub period_ns: i64,
    /// How long the level stays high, nanoseconds.
    pub high_ns: i64,
}

impl PulseTrain {
    fn edge(&self, number: u64) -> LineEdge {
        let pulse = number / 2;
        let rising = number.is_multiple_of(2);
        let start = self.first_ns + pulse as i64 * self.period_ns;
        LineEdge { at_ns: if rising { start } else { start + self.high_ns }, rising, pulse }
    }
}

#[derive(Debug, Default)]
struct Wire {
    train: Option<PulseTrain>,
    pushed: Vec<LineEdge>,
    /// Up to where an input has been told all edges, nanoseconds.
    given_ns: Option<i64>,
    late: u64,
}

/// The wire. Clones are the same wire.
#[derive(Clone, Debug, Default)]
pub struct TriggerLine(Arc<Mutex<Wire>>);

impl TriggerLine {
    /// A wire that carries what is pushed onto it.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A wire that carries a train of pulses without end.
    #[must_use]
    pub fn train(train: PulseTrain) -> Self {
        Self(Arc::new(Mutex::new(Wire { train: Some(train), ..Wire::default() })))
    }

    fn lock(&self) -> MutexGuard<'_, Wire> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts an edge onto the wire. Edges come in order of time.
    pub fn push(&self, at_ns: i64, rising: bool) {
        let mut wire = self.lock();
        let pulse = wire.pushed.last().map_or(0, |last| last.pulse + u64::from(rising));
        wire.late += u64::from(wire.given_ns.is_some_and(|given_ns| at_ns <= given_ns));
        wire.pushed.push(LineEdge { at_ns, rising, pulse });
    }

    /// How many edges were put onto the wire for times that an input had already been told to be without ([`LineTap::until`]):
    /// these reach it out of order. Where it is not 0, the inputs must hold back what they see for longer.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.lock().late
    }

    /// A new input on the wire.
    #[must_use]
    pub fn tap(&self) -> LineTap {
        LineTap { line: self.clone(), next: 0, from_ns: i64::MIN }
    }
}

/// An input on the wire: gives every edge once.
#[derive(Clone, Debug)]
pub struct LineTap {
    line: TriggerLine,
    next: u64,
    /// Nothing before this is given.
    from_ns: i64,
}

impl LineTap {
    /// The edges since the last call, up to and including `now_ns`.
    pub fn until(&mut self, now_ns: i64) -> Vec<LineEdge> {
        let mut edges = Vec::new();
        while let Some(edge) = self.peek().filter(|edge| edge.at_ns <= now_ns) {
            edges.push(edge);
            self.next += 1;
        }
        let mut wire = self.line.lock();
        wire.given_ns = wire.given_ns.max(Some(now_ns));
        edges
    }

    /// Nobody listens until `now_ns`: edges up to and including it are never given, even if they are still to come.
    pub fn skip(&mut self, now_ns: i64) {
        self.from_ns = now_ns + 1;
    }

    /// The time of the next pulse whose number is not in `dropped`, if it has risen by `now_ns`.
    pub fn next_rise(&mut self, now_ns: i64, dropped: &BTreeSet<u64>) -> Option<i64> {
        loop {
            let edge = self.peek().filter(|edge| edge.at_ns <= now_ns)?;
            self.next += 1;
            if edge.rising && !dropped.contains(&edge.pulse) {
                return Some(edge.at_ns);
            }
        }
    }

    /// The next edge that is to be given, if it is known.
    fn peek(&mut self) -> Option<LineEdge> {
        let wire = self.line.lock();
        loop {
            let edge = match &wire.train {
                Some(train) => train.edge(self.next),
                None => wire.pushed.get(self.next as usize).copied()?,
            };
            if edge.at_ns >= self.from_ns {
                return Some(edge);
            }
            self.next += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_taps_see_the_same_edges_once_each() {
        let line = TriggerLine::new();
        let (mut first, mut second) = (line.tap(), line.tap());
        line.push(10, true);
        line.push(20, false);
        line.push(30, true);
        let seen = first.until(20);
        assert_eq!(
            seen.iter().map(|edge| (edge.at_ns, edge.rising, edge.pulse)).collect::<Vec<_>>(),
            [(10, true, 0), (20, false, 0)]
        );
        assert_eq!(first.until(40).len(), 1);
        assert_eq!(second.until(40).len(), 3);
        assert!(second.until(50).is_empty());
    }

    #[test]
    fn edges_from_before_an_input_listened_are_never_given() {
        let line = TriggerLine::new();
        let mut tap = line.tap();
        line.push(10, true);
        tap.skip(25);
        // Told late, as by a board in another process.
        line.push(20, false);
        line.push(30, true);
        assert_eq!(tap.until(40).iter().map(|edge| edge.at_ns).collect::<Vec<_>>(), [30]);
        assert_eq!(line.late(), 0);
    }

    #[test]
    fn an_edge_behind_what_an_input_was_told_counts_as_late() {
        let line = TriggerLine::new();
        let mut tap = line.tap();
        assert!(tap.until(100).is_empty());
        line.push(100, true);
        line.push(101, false);
        assert_eq!((line.late(), tap.until(200).len()), (1, 2));
    }

    #[test]
    fn a_train_repeats_its_pulse() {
        let mut tap = TriggerLine::train(PulseTrain { first_ns: 5, period_ns: 100, high_ns: 30 }).tap();
        let edges = tap.until(135);
        assert_eq!(edges.iter().map(|edge| edge.at_ns).collect::<Vec<_>>(), [5, 35, 105, 135]);
        assert_eq!(edges[3], LineEdge { at_ns: 135, rising: false, pulse: 1 });
    }
}
