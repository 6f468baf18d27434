//! One stream while its recording is read: what of it was found and is not handed out yet.

use std::{
    cell::Cell,
    collections::{BTreeSet, HashMap, VecDeque},
};

use erfgs_events::{ApsFrame, CdEvent, Decoder, Event, EventRows, Sink, StreamDecoder};
use erfgs_scene::pixel::FrameFormat;
use erfgs_session::{
    clock::Exposure,
    container::{BegunDecoder, StreamTotals, hand_over},
    export::sensor_samples,
    source::{Description, Packet},
};

use super::{
    EventClock, FrameLook, SLACK_NS,
    frame::{TimedFrame, WaitingFrame},
    times::Dater,
};

/// A frame of an event sensor comes after the events of its exposure by its readout, and its middle lies half an exposure earlier.
const SENSOR_FRAME_NS: i64 = 2_000_000_000;

/// What to say of what nothing dates.
pub(super) fn undated_message(id: &str, count: u64, what: &str) -> Option<String> {
    (count > 0)
        .then(|| format!("{count} {what} of stream '{id}' were left out: no clock dates them (`erfgs sync` says why)"))
}

/// A stream that is read.
pub(super) struct Feed {
    pub stream: usize,
    pub id: String,
    kind: Kind,
    span_ns: [i64; 2],
    /// Events that wait.
    pub rows: EventRows,
    /// Frames that wait, decoded when they are handed out: what waits for another stream takes no more memory than it was sent with.
    pub frames: VecDeque<WaitingFrame>,
    /// The number of the stream's last packet, where that is known.
    last_sequence: Option<u64>,
    /// Whether no packet will follow.
    ended: bool,
    /// Up to here all of the stream was met, session nanoseconds.
    newest_ns: i64,
    undated: u64,
    damaged: u64,
}

enum Kind {
    Events {
        begun: Box<BegunDecoder>,
        started: bool,
        dater: Dater,
        clock: EventClock,
        events: bool,
        frames: Option<FrameLook>,
    },
    Camera {
        format: FrameFormat,
        deep: bool,
        exposures: HashMap<u64, Exposure>,
        due: BTreeSet<(i64, u64)>,
    },
}

impl Feed {
    pub fn of_events(
        stream: usize,
        id: String,
        begun: BegunDecoder,
        dater: Dater,
        (span_ns, clock, frames): ([i64; 2], EventClock, Option<FrameLook>),
    ) -> Self {
        let begun = Box::new(begun);
        Self::new(stream, id, Kind::Events { begun, started: false, dater, clock, events: true, frames }, span_ns)
    }

    /// Without its events.
    pub fn of_frames(mut self) -> Self {
        if let Kind::Events { events, .. } = &mut self.kind {
            *events = false;
        }
        self
    }

    pub fn of_camera(
        stream: usize,
        description: &Description,
        format: FrameFormat,
        exposures: HashMap<u64, Exposure>,
        (span_ns, deep): ([i64; 2], bool),
    ) -> Self {
        let mids = exposures.iter().map(|(&sequence, exposure)| (exposure.mid_ns, sequence));
        let due = mids.filter(|(mid_ns, _)| (span_ns[0]..span_ns[1]).contains(mid_ns)).collect();
        Self::new(stream, description.id.clone(), Kind::Camera { format, deep, exposures, due }, span_ns)
    }

    fn new(stream: usize, id: String, kind: Kind, span_ns: [i64; 2]) -> Self {
        let (rows, frames) = (EventRows::default(), VecDeque::new());
        let (last_sequence, ended) = (None, false);
        Self {
            stream,
            id,
            kind,
            span_ns,
            rows,
            frames,
            last_sequence,
            ended,
            newest_ns: i64::MIN,
            undated: 0,
            damaged: 0,
        }
    }

    /// The recording says of the stream where it ends: others need not wait for it then.
    pub fn ends_as(&mut self, totals: &StreamTotals) {
        (self.ended, self.last_sequence) = (totals.packets == 0, totals.next_sequence.checked_sub(1));
    }

    /// The next of the frames before a session time that can be decoded, in the order of the recording.
    pub fn next_frame(&mut self, before_ns: i64) -> Option<TimedFrame> {
        loop {
            let at = self.frames.iter().position(|frame| frame.exposure.mid_ns < before_ns)?;
            match self.frames.remove(at)?.decoded() {
                Some(frame) => return Some(frame),
                None => self.damaged += 1,
            }
        }
    }

    /// The host time from which on packets are wanted; `None` for all.
    pub fn first_host_ns(&self, start_ns: i64) -> Option<i64> {
        let first = |t_ns: i64| t_ns.saturating_add(start_ns).saturating_sub(SLACK_NS);
        match &self.kind {
            Kind::Events { begun, .. } => begun.host_ns,
            // A camera whose frames lie elsewhere wants none at all.
            Kind::Camera { due, .. } => Some(due.first().map_or(i64::MAX, |&(mid_ns, _)| first(mid_ns))),
        }
    }

    /// Takes a packet of the stream.
    pub fn take(&mut self, packet: &Packet) {
        self.ended |= self.last_sequence == Some(packet.sequence);
        match &mut self.kind {
            Kind::Events { begun, started, .. } => {
                if packet.sequence < begun.first_sequence {
                    return;
                }
                hand_over(&mut begun.decoder, packet, *started);
                *started = true;
                self.decode(|decoder, taking| {
                    taking.packet(packet.sequence);
                    decoder.decode(&packet.payload, taking);
                });
            }
            Kind::Camera { format, deep, exposures, due } => {
                let Some(exposure) = exposures.get(&packet.sequence) else {
                    self.undated += 1;
                    return;
                };
                if !due.remove(&(exposure.mid_ns, packet.sequence)) {
                    return;
                }
                if packet.damaged {
                    self.damaged += 1;
                    return;
                }
                self.frames.push_back(WaitingFrame {
                    sequence: packet.sequence,
                    exposure: *exposure,
                    format: *format,
                    deep: *deep,
                    payload: packet.payload.clone(),
                });
            }
        }
    }

    /// The recording is over.
    pub fn finish(&mut self) {
        if matches!(self.kind, Kind::Events { .. }) {
            self.decode(|decoder, taking| decoder.finish(taking));
        }
    }

    fn decode(&mut self, work: impl FnOnce(&mut StreamDecoder, &mut Taking<'_>)) {
        let Kind::Events { begun, dater, clock, events, frames, .. } = &mut self.kind else { return };
        let mut taking = Taking {
            over: None,
            dater: Some(dater),
            span_ns: self.span_ns,
            clock: *clock,
            rows: events.then_some(&mut self.rows),
            frames: frames.map(|look| (look, &mut self.frames)),
            sequence: 0,
            newest_ns: self.newest_ns,
            undated: 0,
            damaged: 0,
        };
        work(&mut begun.decoder, &mut taking);
        self.newest_ns = taking.newest_ns;
        let (undated, damaged) = (taking.undated, taking.damaged);
        self.undated += undated;
        self.damaged += damaged;
    }

    /// Whether it may have events.
    pub fn has_events(&self) -> bool {
        matches!(self.kind, Kind::Events { events: true, .. })
    }

    /// Whether it may have frames.
    pub fn has_frames(&self) -> bool {
        matches!(self.kind, Kind::Events { frames: Some(_), .. } | Kind::Camera { .. })
    }

    /// Whether all that the stream saw before a session time was met.
    pub fn has_seen(&self, t_ns: i64) -> bool {
        if self.ended {
            return true;
        }
        match &self.kind {
            Kind::Events { frames, .. } => {
                let slack = if frames.is_some() { SENSOR_FRAME_NS } else { SLACK_NS };
                self.newest_ns >= t_ns.saturating_add(slack)
            }
            Kind::Camera { due, .. } => due.first().is_none_or(|&(mid_ns, _)| mid_ns >= t_ns),
        }
    }

    /// What was left out so far.
    pub fn take_damage(&mut self) -> Vec<String> {
        let what = if matches!(self.kind, Kind::Camera { .. }) { "frames" } else { "events or frames" };
        let (undated, damaged) = (std::mem::take(&mut self.undated), std::mem::take(&mut self.damaged));
        let broken = format!("{damaged} frames of stream '{}' were left out: they are cut or damaged", self.id);
        undated_message(&self.id, undated, what).into_iter().chain((damaged > 0).then_some(broken)).collect()
    }
}

/// Takes what a decoder finds within a span.
pub(super) struct Taking<'a> {
    /// Told when the span is over.
    over: Option<&'a Cell<bool>>,
    /// `None` where all times are the device's and all are wanted.
    dater: Option<&'a mut Dater>,
    span_ns: [i64; 2],
    clock: EventClock,
    rows: Option<&'a mut EventRows>,
    frames: Option<(FrameLook, &'a mut VecDeque<WaitingFrame>)>,
    sequence: u64,
    newest_ns: i64,
    pub undated: u64,
    damaged: u64,
}

impl<'a> Taking<'a> {
    /// Events alone.
    pub fn of_events(
        dater: Option<&'a mut Dater>,
        span_ns: [i64; 2],
        clock: EventClock,
        (rows, over): (&'a mut EventRows, &'a Cell<bool>),
    ) -> Self {
        let (over, rows, frames) = (Some(over), Some(rows), None);
        Self { over, dater, span_ns, clock, rows, frames, sequence: 0, newest_ns: i64::MIN, undated: 0, damaged: 0 }
    }

    /// Session time, where it is known; counted where it is not.
    fn session_ns(&mut self, t_us: u64) -> Option<i64> {
        let t_ns = self.dater.as_mut()?.session_ns(t_us);
        match t_ns {
            Some(t_ns) => {
                self.newest_ns = self.newest_ns.max(t_ns);
                self.over.iter().for_each(|over| over.set(self.newest_ns >= self.span_ns[1].saturating_add(SLACK_NS)));
            }
            None => self.undated += 1,
        }
        t_ns
    }

    fn holds(&self, t_ns: i64) -> bool {
        (self.span_ns[0]..self.span_ns[1]).contains(&t_ns)
    }
}

impl Sink for Taking<'_> {
    fn packet(&mut self, sequence: u64) {
        self.sequence = sequence;
        self.dater.iter_mut().for_each(|dater| dater.packet(sequence));
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.dater.iter_mut().for_each(|dater| dater.discontinuity(t_us));
    }

    fn event(&mut self, event: CdEvent) {
        let device_us = i64::try_from(event.t_us).unwrap_or(i64::MAX);
        let t_us = if self.dater.is_none() {
            device_us
        } else {
            let Some(t_ns) = self.session_ns(event.t_us).filter(|&t_ns| self.holds(t_ns)) else { return };
            if self.clock == EventClock::Device { device_us } else { t_ns.div_euclid(1000) }
        };
        if let Some(rows) = &mut self.rows {
            rows.push(Event { t_us, x: event.x, y: event.y, on: event.on });
        }
    }

    fn frame(&mut self, mut frame: ApsFrame) {
        if self.frames.is_none() {
            return;
        }
        let exposure = [frame.exposure_start_us, frame.exposure_end_us].map(|t_us| self.session_ns(t_us));
        let [Some(start), Some(end)] = exposure else { return };
        let exposure = Exposure::between([start, end]);
        if !self.holds(exposure.mid_ns) {
            return;
        }
        let Some((look, frames)) = &mut self.frames else { return };
        frame.bits = if frame.bits == 16 { look.bits.unwrap_or(16) } else { frame.bits };
        let (encoding, payload) = sensor_samples(&frame);
        let [width, height] = [frame.width, frame.height].map(u32::from);
        let format = encoding.frames().map(|pixels| FrameFormat { pixels, width, height, look: Default::default() });
        let Some(format) = format else {
            self.damaged += 1;
            return;
        };
        let sequence = self.sequence;
        let (deep, payload) = (look.depth.is_deep(format.pixels), payload.into());
        frames.push_back(WaitingFrame { sequence, exposure, format, deep, payload });
    }
}
