//! The wire from a trigger board to the trigger inputs: every input that taps it sees the same edges at the same time.

use std::{
    collections::BTreeSet,
    sync::{Arc, Mutex, PoisonError},
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
        Self(Arc::new(Mutex::new(Wire { train: Some(train), pushed: Vec::new() })))
    }

    /// Puts an edge onto the wire. Edges come in order of time.
    pub fn push(&self, at_ns: i64, rising: bool) {
        let mut wire = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let pulse = wire.pushed.last().map_or(0, |last| last.pulse + u64::from(rising));
        wire.pushed.push(LineEdge { at_ns, rising, pulse });
    }

    /// A new input on the wire.
    #[must_use]
    pub fn tap(&self) -> LineTap {
        LineTap { line: self.clone(), next: 0 }
    }
}

/// An input on the wire: gives every edge once.
#[derive(Clone, Debug)]
pub struct LineTap {
    line: TriggerLine,
    next: u64,
}

impl LineTap {
    /// The edges since the last call, up to and including `now_ns`.
    pub fn until(&mut self, now_ns: i64) -> Vec<LineEdge> {
        let mut edges = Vec::new();
        while let Some(edge) = self.peek().filter(|edge| edge.at_ns <= now_ns) {
            edges.push(edge);
            self.next += 1;
        }
        edges
    }
}

impl LineTap {
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

    fn peek(&self) -> Option<LineEdge> {
        let wire = self.line.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &wire.train {
            Some(train) => Some(train.edge(self.next)),
            None => wire.pushed.get(self.next as usize).copied(),
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
    fn a_train_repeats_its_pulse() {
        let mut tap = TriggerLine::train(PulseTrain { first_ns: 5, period_ns: 100, high_ns: 30 }).tap();
        let edges = tap.until(135);
        assert_eq!(edges.iter().map(|edge| edge.at_ns).collect::<Vec<_>>(), [5, 35, 105, 135]);
        assert_eq!(edges[3], LineEdge { at_ns: 135, rising: false, pulse: 1 });
    }
}
