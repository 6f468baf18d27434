//! Event files on the session's clock, and the pulses at their trigger inputs.

use std::path::PathBuf;

use erfgs_events::{CdEvent, Edge, EventFileHints, SensorSize, Sink};
use erfgs_session::{
    container::{ContainerError, Entry, EventFileRecording, HostClock},
    source::{Description, Packet},
    trigger::code::SensedPulse,
};
use erfgs_sync::pulses;

use super::{
    PlanError,
    plan::{Events, Plan},
};

/// An event file, and where its times lie.
pub(super) struct EventStream {
    pub description: Description,
    pub path: PathBuf,
    recording: EventFileRecording,
    /// Session time of the first item, nanoseconds.
    pub starts_ns: i64,
    /// Its trigger input, where somebody has asked.
    pulses: Option<Vec<Pulse>>,
}

/// A pulse at a trigger input, in session time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pulse {
    pub rise_ns: i64,
    /// `None` where its end was not seen.
    pub width_ns: Option<i64>,
}

/// Edges by host time, microseconds.
struct Edges {
    clock: HostClock,
    found: Vec<Edge>,
}

impl Sink for Edges {
    fn event(&mut self, event: CdEvent) {
        self.clock.host_ns(event.t_us);
    }

    fn edge(&mut self, edge: Edge) {
        let t_us = (self.clock.host_ns(edge.t_us) / 1000).unsigned_abs();
        self.found.push(Edge { t_us, ..edge });
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.clock.discontinuity(t_us);
    }
}

/// The pulses at the trigger input of an event file, by microseconds from its first item on.
pub(super) fn pulses_of(recording: &EventFileRecording) -> Result<Vec<SensedPulse>, ContainerError> {
    let mut edges = Edges { clock: recording.clock(), found: Vec::new() };
    recording.decode_events(&mut edges, |_| {})?;
    Ok(pulses(&edges.found, edges.found.first().map_or(0, |edge| edge.channel)))
}

impl EventStream {
    /// Opens the event files of a plan, and finds where their times lie.
    pub fn open_all(plan: &Plan, opened: &mut impl FnMut(usize)) -> Result<Vec<Self>, PlanError> {
        let mut streams: Vec<Self> = Vec::new();
        for events in &plan.events {
            opened(streams.len());
            let mut stream = Self::open(plan, events)?;
            let above = |name: &String| streams.iter().position(|stream| stream.description.id == *name);
            let [clock_of, pulses_of] = [&events.clock_of, &events.pulses_of].map(|name| name.as_ref().and_then(above));
            if let Some(at) = clock_of {
                let apart_us = i128::from(stream.recording.first_us()) - i128::from(streams[at].recording.first_us());
                let apart_ns = i64::try_from(1000 * apart_us).unwrap_or(i64::MAX);
                stream.starts_ns = streams[at].starts_ns.saturating_add(apart_ns);
            }
            if let Some(at) = pulses_of {
                let first = streams[at].pulses()?.first().copied();
                let own = stream.pulses()?.first().copied();
                let (Some(first), Some(own)) = (first, own) else {
                    let without = if first.is_none() { &streams[at] } else { &stream };
                    return Err(without.without_pulses());
                };
                stream.shift(first.rise_ns.saturating_sub(own.rise_ns));
            }
            streams.push(stream);
        }
        Ok(streams)
    }

    fn open(plan: &Plan, events: &Events) -> Result<Self, PlanError> {
        let path = plan.folder.join(&events.file);
        let wrong = |what: String| PlanError::File { id: events.id.clone(), path: path.clone(), what };
        let size = events.size.map(|[width, height]| SensorSize { width, height }.checked()).transpose();
        let columns = events.columns.as_ref().map(|columns| columns.parse()).transpose();
        let hints = EventFileHints {
            size: size.map_err(|error| wrong(error.to_string()))?,
            columns: columns.map_err(|error| wrong(format!("columns: {error}")))?,
        };
        let recording = EventFileRecording::open(&path, &hints)?;
        let of_file = recording.summary().streams.first().map(|stream| &stream.description);
        let of_file = of_file.ok_or_else(|| wrong("it holds no events".into()))?;
        let description = Description { id: events.id.clone(), ..of_file.clone() };
        let starts_ns = (1e9 * events.starts_s.unwrap_or(0.0)) as i64;
        Ok(Self { description, path, recording, starts_ns, pulses: None })
    }

    fn shift(&mut self, by_ns: i64) {
        self.starts_ns = self.starts_ns.saturating_add(by_ns);
        for pulse in self.pulses.iter_mut().flatten() {
            pulse.rise_ns = pulse.rise_ns.saturating_add(by_ns);
        }
    }

    /// The pulses at its trigger input.
    pub fn pulses(&mut self) -> Result<&[Pulse], PlanError> {
        if self.pulses.is_none() {
            let pulse = |rise_us: i64| self.starts_ns.saturating_add(rise_us.saturating_mul(1000));
            let found = pulses_of(&self.recording)?.into_iter();
            self.pulses =
                Some(found.map(|seen| Pulse { rise_ns: pulse(seen.rise), width_ns: seen.width_ns }).collect());
        }
        Ok(self.pulses.as_deref().unwrap_or_default())
    }

    /// The falling edges, as pulses that begin with them.
    pub fn falls(&mut self) -> Result<Vec<Pulse>, PlanError> {
        let fall =
            |pulse: &Pulse| Some(Pulse { rise_ns: pulse.rise_ns.saturating_add(pulse.width_ns?), width_ns: None });
        Ok(self.pulses()?.iter().filter_map(fall).collect())
    }

    pub fn without_pulses(&self) -> PlanError {
        let what = "it has no edge of its trigger input: was the input switched on?".to_owned();
        PlanError::File { id: self.description.id.clone(), path: self.path.clone(), what }
    }

    /// Its packets in session time.
    pub fn packets(&self) -> impl Iterator<Item = Result<Packet, ContainerError>> + use<> {
        let starts_ns = self.starts_ns;
        self.recording.messages(None).filter_map(move |entry| match entry {
            Ok(Entry::Packet { packet, .. }) => {
                Some(Ok(Packet { host_ns: packet.host_ns.saturating_add(starts_ns), ..packet }))
            }
            Ok(_) => None,
            Err(error) => Some(Err(error)),
        })
    }

    /// How long it is, nanoseconds.
    pub fn length_ns(&self) -> i64 {
        self.recording.summary().span_ns().map_or(0, |[_, last]| last)
    }

    /// What of the file was passed over, a sentence each.
    pub fn damage(&self) -> impl Iterator<Item = String> {
        self.recording.summary().damage.iter().map(ToString::to_string)
    }
}
