//! What a recording holds of each of its streams, as far as a verdict rests on it: read in one pass.

use std::{
    collections::BTreeMap,
    io::{Read, Seek},
};

use erfgs_events::{Anomalies, CdEvent, Decoder, Edge, EventBatch, ImuSample, Sink, StreamDecoder};
use erfgs_session::trigger::protocol::{Message, Reader};
use erfgs_session::{
    clock::Sample,
    container::{ContainerError, Entry, Session, StreamTotals, hand_over},
    source::{Counters, Description, Encoding, Incident, Packet, StampClock},
};
use erfgs_sync::{BOARD_NS_PER_TICK, Board, BoardLines, SyncOptions, Synchronisation, synchronise};

use crate::{histogram::Intervals, holes::Holes, rate::RateFit};

/// Edges that are kept of an input: one that floats may have a million a second.
const MAX_EDGES: usize = 200_000;
/// Event cameras count microseconds.
const EVENTS_NS_PER_TICK: f64 = 1000.0;

/// A recording of some devices.
#[derive(Debug)]
pub struct Recording {
    /// From its beginning to where the devices were stopped, seconds.
    pub seconds: f64,
    /// Its streams.
    pub streams: Vec<Observed>,
    /// The clocks of all streams, as `erfgs sync` fits them.
    pub sync: Synchronisation,
}

impl Recording {
    /// The stream of a device.
    #[must_use]
    pub fn stream(&self, id: &str) -> Option<&Observed> {
        self.streams.iter().find(|stream| stream.description.id == id)
    }
}

/// What was observed of a stream. Times are session time, nanoseconds.
#[derive(Debug)]
pub struct Observed {
    /// What the stream is.
    pub description: Description,
    /// Packets, bytes, and what is missing of them.
    pub totals: StreamTotals,
    /// When each packet arrived.
    pub arrivals_ns: Vec<i64>,
    /// When each frame was stamped: by the camera's own clock or by the kernel, else when it arrived.
    pub frames_ns: Vec<i64>,
    /// Whose clock frames are stamped by; `None` where they have no stamps.
    pub stamped_by: Option<StampClock>,
    /// Frames that the camera or the kernel counted and that did not come.
    pub missing_frames: u64,
    /// Why the first whole frame cannot be decoded, if it cannot.
    pub frame_problem: Option<String>,
    /// The device's own clock against arrivals; `None` where the stream has no time of its own.
    pub clock: Option<RateFit>,
    /// Of an event camera.
    pub events: Option<ObservedEvents>,
    /// Of a trigger board.
    pub board: Option<ObservedBoard>,
    /// What its driver reported.
    pub incidents: Vec<Incident>,
    /// What its driver counted, where the recorder was one.
    pub counters: Counters,
    /// Packets that the recorder dropped, by the stage at which it did.
    pub dropped: BTreeMap<String, u64>,
}

/// What was decoded of an event camera.
#[derive(Debug, Default)]
pub struct ObservedEvents {
    /// Events, and those that brighten.
    pub events: u64,
    /// Of them, brighter.
    pub on: u64,
    /// Edges at the trigger input, the first 200,000.
    pub edges: Vec<Edge>,
    /// Inertial samples, and the sum of their temperatures.
    pub imu_samples: u64,
    pub(crate) imu_celsius: f64,
    /// Time of the first and the last of all, microseconds of the camera.
    pub range_us: Option<[u64; 2]>,
    /// What was wrong with the words.
    pub anomalies: Anomalies,
    /// Breaks of the camera's time that the driver did not report.
    pub unexplained_breaks: u64,
    /// Places between two packets at which events are missing.
    pub holes: Holes,
}

impl ObservedEvents {
    /// Mean temperature of the inertial unit, degrees Celsius.
    #[must_use]
    pub fn imu_celsius(&self) -> Option<f64> {
        (self.imu_samples > 0).then(|| self.imu_celsius / self.imu_samples as f64)
    }

    /// Edges that rise, and edges that fall.
    #[must_use]
    pub fn edge_counts(&self) -> [u64; 2] {
        let rising = self.edges.iter().filter(|edge| edge.rising).count() as u64;
        [rising, self.edges.len() as u64 - rising]
    }

    fn saw(&mut self, t_us: u64) {
        let [first, last] = self.range_us.get_or_insert([t_us, t_us]);
        (*first, *last) = ((*first).min(t_us), (*last).max(t_us));
    }
}

/// What a trigger board sent.
#[derive(Debug)]
pub struct ObservedBoard {
    /// Its pulses and its clock; `None` if no line has a time.
    pub board: Option<Board>,
    /// Lines that cannot be read, the first half line not counted.
    pub damaged_lines: u64,
}

/// Reads a recording. `ended_host_ns`: when its devices were stopped, if that is known; else it ends with its last packet.
///
/// # Errors
/// If the session cannot be read.
pub fn observe<R: Read + Seek>(
    session: &mut Session<R>,
    ended_host_ns: Option<i64>,
) -> Result<Recording, ContainerError> {
    let summary = session.summary().clone();
    let start_ns = summary.start.host_ns;
    let mut gathering = Vec::new();
    for (index, stream) in summary.streams.iter().enumerate() {
        let decoder = session.decoder_from(index, None)?.map(|begun| begun.decoder);
        gathering.push(Gathering::new(stream.description.clone(), decoder));
    }
    for entry in session.messages(None) {
        match entry? {
            Entry::Packet { stream, packet } => {
                if let Some(gathering) = gathering.get_mut(stream) {
                    gathering.take(&packet, start_ns);
                }
            }
            _ => continue,
        }
    }
    let sync = synchronise(session, SyncOptions::default(), |_| {})?;
    let end_ns = ended_host_ns.or(summary.span_ns().map(|[_, last]| last)).unwrap_or(start_ns);
    let mut streams = Vec::new();
    for (stream, gathering) in summary.streams.iter().zip(gathering) {
        let id = &stream.description.id;
        let status = summary.totals.status.as_ref().and_then(|status| status.streams.get(id));
        let incidents = summary.totals.incidents.iter().filter(|entry| entry.stream == *id);
        streams.push(Observed {
            totals: stream.totals,
            incidents: incidents.map(|entry| entry.incident.clone()).collect(),
            counters: status.map(|status| status.counters).unwrap_or_default(),
            dropped: status.map(|status| status.dropped.clone()).unwrap_or_default(),
            ..gathering.finish()
        });
    }
    Ok(Recording { seconds: end_ns.saturating_sub(start_ns) as f64 * 1e-9, streams, sync })
}

/// A stream that is being read.
struct Gathering {
    observed: Observed,
    decoder: Option<StreamDecoder>,
    lines: BoardLines,
    reader: Reader,
    /// The count of the last frame.
    counted: Option<u32>,
    /// The driver reported a break, and nothing is dated since.
    after_break: bool,
    /// Device time and arrival of each packet, apart for each stretch between two breaks.
    samples: Vec<Vec<Sample>>,
}

impl Gathering {
    fn new(description: Description, decoder: Option<StreamDecoder>) -> Self {
        let observed = Observed::nothing(description);
        let (lines, reader) = (BoardLines::default(), Reader::new());
        Self { observed, decoder, lines, reader, counted: None, after_break: false, samples: vec![Vec::new()] }
    }

    fn take(&mut self, packet: &Packet, start_ns: i64) {
        let arrived_ns = packet.host_ns.saturating_sub(start_ns);
        let is_first = self.observed.arrivals_ns.is_empty();
        self.observed.arrivals_ns.push(arrived_ns);
        if packet.discontinuity && !is_first {
            self.samples.push(Vec::new());
        }
        match self.observed.description.encoding {
            Encoding::TriggerLines => self.take_lines(packet, start_ns, arrived_ns),
            encoding if encoding.is_events() => self.take_events(packet, arrived_ns, is_first),
            _ => self.take_frame(packet, start_ns, arrived_ns),
        }
    }

    fn sample(&mut self, ticks: i64, session_ns: i64) {
        if let Some(samples) = self.samples.last_mut() {
            samples.push(Sample { ticks, session_ns });
        }
    }

    fn take_lines(&mut self, packet: &Packet, start_ns: i64, arrived_ns: i64) {
        self.lines.take(packet, start_ns);
        if packet.discontinuity {
            self.reader.restart();
        }
        let (mut pulses, mut restarted) = (Vec::new(), false);
        self.reader.push(&packet.payload, |message| match message {
            Message::Pulse(pulse) => pulses.push(pulse.tick),
            Message::Boot { .. } => restarted = true,
            _ => {}
        });
        if restarted {
            self.samples.push(Vec::new());
        }
        pulses.into_iter().for_each(|tick| self.sample(i64::try_from(tick).unwrap_or(i64::MAX), arrived_ns));
    }

    fn take_events(&mut self, packet: &Packet, arrived_ns: i64, is_first: bool) {
        let (Some(decoder), Some(events)) = (&mut self.decoder, &mut self.observed.events) else { return };
        hand_over(decoder, packet, !is_first);
        let mut found = PacketSink::new(events);
        decoder.decode(&packet.payload, &mut found);
        let PacketSink { last_us, breaks, span_us, longest_us, .. } = found;
        let whole = breaks == 0 && !packet.discontinuity;
        events.holes.take(span_us.filter(|_| whole), longest_us);
        // A break shows at the first time word behind it, which may come in a later packet.
        self.after_break |= packet.discontinuity;
        let unexplained = breaks.saturating_sub(u64::from(self.after_break));
        self.after_break &= breaks == 0 && last_us.is_none();
        if unexplained > 0 && !is_first {
            events.unexplained_breaks += unexplained;
            self.samples.push(Vec::new());
        }
        if let Some(t_us) = last_us {
            self.sample(i64::try_from(t_us).unwrap_or(i64::MAX), arrived_ns);
        }
    }

    fn take_frame(&mut self, packet: &Packet, start_ns: i64, arrived_ns: i64) {
        let observed = &mut self.observed;
        if observed.frames_ns.is_empty() && !packet.damaged {
            let format = observed.description.frame_format();
            observed.frame_problem =
                format.and_then(|format| format.picture(&packet.payload).err()).map(|error| error.to_string());
        }
        let Some(stamp) = packet.stamp else { return observed.frames_ns.push(arrived_ns) };
        observed.stamped_by.get_or_insert(stamp.clock);
        // A driver that counts backwards has started anew.
        let step = self.counted.map_or(1, |before| stamp.sequence.wrapping_sub(before));
        if step < u32::MAX / 2 && !packet.discontinuity {
            observed.missing_frames += u64::from(step.saturating_sub(1));
        }
        self.counted = Some(stamp.sequence);
        match stamp.clock {
            StampClock::Camera => {
                observed.frames_ns.push(stamp.kernel_ns);
                self.sample(stamp.kernel_ns, arrived_ns);
            }
            StampClock::Monotonic => observed.frames_ns.push(stamp.kernel_ns.saturating_sub(start_ns)),
            StampClock::Unknown => observed.frames_ns.push(arrived_ns),
        }
    }

    fn finish(self) -> Observed {
        let Self { mut observed, decoder, lines, reader, samples, .. } = self;
        if let (Some(events), Some(mut decoder)) = (&mut observed.events, decoder) {
            decoder.finish(&mut PacketSink::new(events));
            events.anomalies = decoder.anomalies();
        }
        let ns_per_tick = match observed.description.encoding {
            Encoding::TriggerLines => BOARD_NS_PER_TICK,
            encoding if encoding.is_events() => EVENTS_NS_PER_TICK,
            _ => 1.0,
        };
        // The longest stretch without a break tells most.
        let longest = samples.iter().max_by_key(|samples| samples.len()).filter(|samples| !samples.is_empty());
        observed.clock = longest.map(|samples| RateFit::of(samples, ns_per_tick));
        if observed.description.encoding == Encoding::TriggerLines {
            observed.board = Some(ObservedBoard { damaged_lines: reader.damaged(), board: lines.finish().ok() });
        }
        observed
    }
}

impl Observed {
    /// Of a stream of which nothing came.
    pub(crate) fn nothing(description: Description) -> Self {
        let is_events = description.encoding.is_events();
        Self {
            description,
            totals: StreamTotals::default(),
            arrivals_ns: Vec::new(),
            frames_ns: Vec::new(),
            stamped_by: None,
            missing_frames: 0,
            frame_problem: None,
            clock: None,
            events: is_events.then(ObservedEvents::default),
            board: None,
            incidents: Vec::new(),
            counters: Counters::default(),
            dropped: BTreeMap::new(),
        }
    }

    /// Whether the stream is of frames.
    #[must_use]
    pub fn is_frames(&self) -> bool {
        self.description.encoding.is_frames()
    }

    /// The intervals that tell most of the stream: between frames, rising edges or pulses, else between packets. With a name.
    #[must_use]
    pub fn intervals(&self) -> (&'static str, Intervals) {
        if self.is_frames() {
            return ("frames", Intervals::of(&self.frames_ns));
        }
        if let Some(board) = self.board.as_ref().and_then(|lines| lines.board.as_ref()) {
            let rises: Vec<i64> = board.pulses.values().map(|pulse| board.rise_ns(pulse)).collect();
            return ("pulses", Intervals::of(&rises));
        }
        let edges = self.events.iter().flat_map(|events| &events.edges).filter(|edge| edge.rising);
        let rises: Vec<i64> =
            edges.map(|edge| i64::try_from(edge.t_us.saturating_mul(1000)).unwrap_or(i64::MAX)).collect();
        if rises.len() > 1 {
            return ("rising-edges", Intervals::of(&rises));
        }
        ("packets", self.packet_intervals())
    }

    /// The intervals between packets.
    #[must_use]
    pub fn packet_intervals(&self) -> Intervals {
        Intervals::of(&self.arrivals_ns)
    }

    /// Bytes a second between the first and the last packet; `None` where they span no time.
    #[must_use]
    pub fn bytes_per_s(&self) -> Option<f64> {
        let span_ns = self.totals.last_host_ns?.saturating_sub(self.totals.first_host_ns?);
        (span_ns > 0).then(|| self.totals.bytes as f64 / (span_ns as f64 * 1e-9))
    }

    /// Frames a second by their stamps; `None` of fewer than three.
    #[must_use]
    pub fn frames_per_s(&self) -> Option<f64> {
        let [first, .., last] = self.frames_ns[..] else { return None };
        let span_ns = last.saturating_sub(first);
        (self.frames_ns.len() > 2 && span_ns > 0).then(|| (self.frames_ns.len() - 1) as f64 / (span_ns as f64 * 1e-9))
    }
}

/// What the decoder finds in a packet.
struct PacketSink<'a> {
    events: &'a mut ObservedEvents,
    last_us: Option<u64>,
    breaks: u64,
    /// The first and the last event, and the longest time between two, microseconds.
    span_us: Option<[u64; 2]>,
    longest_us: u64,
}

impl<'a> PacketSink<'a> {
    fn new(events: &'a mut ObservedEvents) -> Self {
        Self { events, last_us: None, breaks: 0, span_us: None, longest_us: 0 }
    }

    fn event_at(&mut self, t_us: u64) {
        let [_, last] = self.span_us.get_or_insert([t_us, t_us]);
        self.longest_us = self.longest_us.max(t_us.saturating_sub(*last));
        *last = t_us;
    }

    fn saw(&mut self, t_us: u64) {
        self.last_us = self.last_us.max(Some(t_us));
        self.events.saw(t_us);
    }
}

impl Sink for PacketSink<'_> {
    fn event(&mut self, event: CdEvent) {
        self.saw(event.t_us);
        self.event_at(event.t_us);
        self.events.events += 1;
        self.events.on += u64::from(event.on);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        batch.t_us.first().iter().for_each(|&&t_us| self.saw(t_us));
        batch.t_us.last().iter().for_each(|&&t_us| self.saw(t_us));
        batch.t_us.iter().for_each(|&t_us| self.event_at(t_us));
        self.events.events += batch.t_us.len() as u64;
        self.events.on += batch.on.iter().filter(|&&on| on).count() as u64;
    }

    fn edge(&mut self, edge: Edge) {
        self.saw(edge.t_us);
        if self.events.edges.len() < MAX_EDGES {
            self.events.edges.push(edge);
        }
    }

    fn imu(&mut self, sample: ImuSample) {
        self.saw(sample.t_us);
        if sample.temperature.is_finite() {
            self.events.imu_samples += 1;
            self.events.imu_celsius += f64::from(sample.temperature);
        }
    }

    fn discontinuity(&mut self, _t_us: u64) {
        self.breaks += 1;
        // What came before it is of another time.
        self.last_us = None;
    }
}

#[cfg(test)]
mod tests {
    use erfgs_events::EventEncoding;
    use serde_json::Map;

    use super::*;

    /// EVT3: a time word of 4.096 ms, a row, and an event in it.
    const fn time(milliseconds: u16) -> u16 {
        0x8000 | (milliseconds / 4)
    }
    const ROW: u16 = 0x0005;
    const EVENT: u16 = 0x2805;

    /// Packets of words, each behind a break that the driver reports or not; how many breaks are not explained.
    fn unexplained(packets: &[(bool, &[u16])]) -> u64 {
        let mut description = Description::trigger_board("eye", Map::new());
        description.encoding = Encoding::Events(EventEncoding::Evt3);
        let mut gathering = Gathering::new(description, Some(StreamDecoder::new(EventEncoding::Evt3, None)));
        for (sequence, (discontinuity, words)) in packets.iter().enumerate() {
            let payload: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            let packet = Packet {
                sequence: sequence as u64,
                host_ns: sequence as i64 * 4_000_000,
                discontinuity: *discontinuity,
                damaged: false,
                stamp: None,
                payload: payload.into(),
            };
            gathering.take(&packet, 0);
        }
        gathering.finish().events.unwrap().unexplained_breaks
    }

    #[test]
    fn a_break_that_the_driver_reports_explains_the_first_time_word_behind_it_and_no_other() {
        let (first, back) = ([time(400), ROW, EVENT], [time(8), time(12), ROW, EVENT]);
        assert_eq!(unexplained(&[(false, &first), (true, &[time(480), ROW, EVENT])]), 0);
        // The first packet behind it is cut off before its first time word.
        assert_eq!(unexplained(&[(false, &first), (true, &[ROW, EVENT]), (false, &[time(480), ROW, EVENT])]), 0);
        assert_eq!(unexplained(&[(false, &first), (false, &back)]), 1);
        assert_eq!(unexplained(&[(false, &first), (true, &[time(480), ROW, EVENT]), (false, &back)]), 1);
    }
}
