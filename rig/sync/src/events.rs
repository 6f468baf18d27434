//! What an event camera's stream tells of its clock: edges and arrivals, apart for each stretch between two breaks.

use erfgs_events::{ApsFrame, CdEvent, Edge, EventBatch, Sink};
use erfgs_session::clock::Sample;

use super::lamp::Counts;

/// Breaks that are told apart. A stream with more of them is noise, and its last stretch is the rest of it.
const MAX_STRETCHES: usize = 100_000;

/// What lies between two breaks.
#[derive(Default)]
pub(super) struct Stretch {
    /// The packet in which it begins, and with which break in there (0: before all of them).
    pub place: (u64, u32),
    /// When that packet arrived, session nanoseconds.
    pub arrived_ns: i64,
    pub edges: Vec<Edge>,
    /// The packet of each edge.
    packets: Vec<u64>,
    /// For each packet its number, the last time in it, and its arrival.
    pub arrivals: Vec<(u64, Sample)>,
    /// If a lamp is looked for.
    pub counts: Option<Counts>,
}

impl Stretch {
    fn is_empty(&self) -> bool {
        self.edges.is_empty() && self.arrivals.is_empty()
    }

    /// What comes before a packet, and what comes from it on.
    pub fn cut(mut self, sequence: u64) -> (Self, Self) {
        let edge = self.packets.partition_point(|&of| of < sequence);
        let arrival = self.arrivals.partition_point(|&(of, _)| of < sequence);
        let arrivals = self.arrivals.split_off(arrival);
        let after = Self {
            place: (sequence, 0),
            arrived_ns: arrivals.first().map_or(self.arrived_ns, |(_, first)| first.session_ns),
            edges: self.edges.split_off(edge),
            packets: self.packets.split_off(edge),
            arrivals,
            counts: None,
        };
        // Events of both clocks were counted together.
        self.counts = None;
        (self, after)
    }
}

/// Gathers stretches while a stream is decoded.
pub(super) struct Stretches {
    found: Vec<Stretch>,
    counting: bool,
    /// Number of the packet that is decoded, and breaks in it so far.
    at: (u64, u32),
    arrival_ns: i64,
    last_us: Option<u64>,
}

impl Stretches {
    /// None yet. `counting`: events are counted, too, so that a lamp can be found in them.
    pub fn new(counting: bool) -> Self {
        let mut stretches = Self { found: Vec::new(), counting, at: (0, 0), arrival_ns: 0, last_us: None };
        stretches.open();
        stretches
    }

    /// What is decoded next arrived then, session nanoseconds.
    pub fn begin(&mut self, sequence: u64, arrival_ns: i64) {
        (self.at, self.arrival_ns) = ((sequence, 0), arrival_ns);
        if let [only] = &mut self.found[..]
            && only.is_empty()
        {
            only.arrived_ns = arrival_ns;
        }
    }

    /// The packet has been decoded.
    pub fn end(&mut self) {
        let sample = self.last_us.take().and_then(|t_us| i64::try_from(t_us).ok());
        if let (Some(ticks), Some(stretch)) = (sample, self.found.last_mut()) {
            stretch.arrivals.push((self.at.0, Sample { ticks, session_ns: self.arrival_ns }));
        }
    }

    /// The stretches that have something to date, in the order of the stream. The first is there in any case.
    pub fn finish(self) -> Vec<Stretch> {
        self.found
    }

    /// Begins a stretch here, or moves the last one here if there was nothing in it.
    fn open(&mut self) {
        if self.found.len() == MAX_STRETCHES {
            return;
        }
        if self.found.last().is_some_and(Stretch::is_empty) {
            self.found.pop();
        }
        let counts = self.counting.then(Counts::default);
        let (place, arrived_ns) = (self.at, self.arrival_ns);
        self.found.push(Stretch { place, arrived_ns, counts, ..Stretch::default() });
    }

    fn saw(&mut self, t_us: u64) {
        self.last_us = self.last_us.max(Some(t_us));
    }

    fn count(&mut self, t_us: u64, on: bool) {
        if let Some(counts) = self.found.last_mut().and_then(|stretch| stretch.counts.as_mut()) {
            counts.add(t_us, on);
        }
    }
}

impl Sink for Stretches {
    fn event(&mut self, event: CdEvent) {
        self.saw(event.t_us);
        self.count(event.t_us, event.on);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        batch.t_us.last().iter().for_each(|&&t_us| self.saw(t_us));
        if self.counting {
            std::iter::zip(batch.t_us, batch.on).for_each(|(&t_us, &on)| self.count(t_us, on));
        }
    }

    fn edge(&mut self, edge: Edge) {
        self.saw(edge.t_us);
        if let Some(stretch) = self.found.last_mut() {
            stretch.edges.push(edge);
            stretch.packets.push(self.at.0);
        }
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.saw(frame.exposure_end_us);
    }

    fn discontinuity(&mut self, _t_us: u64) {
        // What came before belongs to the old time, and arrived with this packet.
        self.end();
        self.at.1 = self.at.1.saturating_add(1);
        self.open();
    }
}
