//! From a session file to the synchronisation of its streams.

use std::{
    collections::BTreeMap,
    io::{Read, Seek},
};

use erfgs_session::{
    clock::Sample,
    codec::{CdEvent, Decoder, Edge, EventBatch, Sink, StreamDecoder},
    container::{ContainerError, Entry, Session, Stream, hand_over, sensor_size},
    source::{Description, Encoding, Packet, StampClock},
};

use super::{
    board::{Board, BoardLines},
    edges,
    frames::{self, Arrived},
    report::{StreamSync, Synchronisation, Tier, VERSION},
};

/// A plot of more points than this shows no more.
const MAX_POINTS: usize = 4000;

/// What is gathered of an event camera: edges, and for each packet its last time and its arrival.
struct Events {
    decoder: Option<StreamDecoder>,
    sink: Edges,
    arrivals: Vec<Sample>,
}

/// Keeps edges and the last time.
#[derive(Default)]
struct Edges {
    edges: Vec<Edge>,
    last_us: Option<u64>,
    discontinuities: u64,
}

impl Sink for Edges {
    fn event(&mut self, event: CdEvent) {
        self.last_us = Some(event.t_us);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.last_us = batch.t_us.last().copied().or(self.last_us);
    }

    fn edge(&mut self, edge: Edge) {
        self.edges.push(edge);
        self.last_us = Some(edge.t_us);
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.discontinuities += 1;
        self.last_us = Some(t_us);
    }
}

enum Gathered {
    Events(Box<Events>),
    Frames(Vec<Arrived>),
    Board(BoardLines),
}

/// Reads a session through and fits all its clocks. `progress` is called with the bytes of payload read so far.
///
/// # Errors
/// If the session cannot be read. Damaged places are passed over; the session's summary tells them.
pub fn synchronise<R: Read + Seek>(
    session: &mut Session<R>,
    mut progress: impl FnMut(u64),
) -> Result<Synchronisation, ContainerError> {
    let streams = session.summary().streams.clone();
    let start_ns = session.summary().start.host_ns;
    let mut gathered: Vec<Gathered> = streams.iter().map(|stream| gather(&stream.description)).collect();
    let mut bytes = 0;
    for entry in session.messages(None) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) => (stream, packet),
            Err(error @ (ContainerError::Read { .. } | ContainerError::Compression { .. })) => return Err(error),
            Ok(_) | Err(_) => continue,
        };
        bytes += packet.payload.len() as u64;
        if let Some(gathered) = gathered.get_mut(stream) {
            gathered.take(&packet, start_ns);
        }
        progress(bytes);
    }
    let name = session.path().file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(Synchronisation { version: VERSION, session: name, streams: fit_all(&streams, gathered) })
}

fn gather(description: &Description) -> Gathered {
    match description.encoding {
        Encoding::TriggerLines => Gathered::Board(BoardLines::default()),
        encoding if encoding.is_events() => Gathered::Events(Box::new(Events {
            decoder: StreamDecoder::new(encoding, sensor_size(description)),
            sink: Edges::default(),
            arrivals: Vec::new(),
        })),
        _ => Gathered::Frames(Vec::new()),
    }
}

impl Gathered {
    fn take(&mut self, packet: &Packet, start_ns: i64) {
        let arrival_ns = packet.host_ns.saturating_sub(start_ns);
        match self {
            Self::Board(lines) => lines.take(packet, start_ns),
            Self::Frames(frames) => {
                let stamp = packet.stamp.filter(|stamp| stamp.clock == StampClock::Monotonic);
                let stamp_ns = stamp.map_or(arrival_ns, |stamp| stamp.kernel_ns.saturating_sub(start_ns));
                frames.push(Arrived { sequence: packet.sequence, stamp_ns });
            }
            Self::Events(events) => {
                let Some(decoder) = &mut events.decoder else { return };
                hand_over(decoder, packet, !events.arrivals.is_empty());
                events.sink.last_us = None;
                decoder.decode(&packet.payload, &mut events.sink);
                if let Some(ticks) = events.sink.last_us.and_then(|t_us| i64::try_from(t_us).ok()) {
                    events.arrivals.push(Sample { ticks, session_ns: arrival_ns });
                }
            }
        }
    }
}

fn fit_all(streams: &[Stream], gathered: Vec<Gathered>) -> Vec<StreamSync> {
    let ids = || streams.iter().map(|stream| stream.description.id.clone());
    let mut found: BTreeMap<String, StreamSync> = BTreeMap::new();
    let mut board = None;
    let mut others = Vec::new();
    for (stream, gathered) in std::iter::zip(streams, gathered) {
        match gathered {
            Gathered::Board(lines) => {
                let (fit, sync) = fit_board(&stream.description.id, lines);
                // The first board that gave pulses counts.
                board = board.or(fit.filter(|board: &Board| !board.pulses.is_empty()));
                found.insert(sync.id.clone(), sync);
            }
            other => others.push((stream, other)),
        }
    }
    for (stream, gathered) in others {
        let sync = match gathered {
            Gathered::Events(events) => fit_events(&stream.description.id, &events, board.as_ref()),
            Gathered::Frames(frames) => fit_frames(&stream.description, &frames, board.as_ref()),
            Gathered::Board(_) => continue,
        };
        found.insert(sync.id.clone(), sync);
    }
    ids().filter_map(|id| found.remove(&id)).collect()
}

fn empty(id: &str, tier: Tier) -> StreamSync {
    StreamSync {
        id: id.to_owned(),
        tier,
        clock: None,
        matched: None,
        exposures: None,
        notes: Vec::new(),
        points: Vec::new(),
    }
}

fn fit_board(id: &str, lines: BoardLines) -> (Option<Board>, StreamSync) {
    let mut sync = empty(id, Tier::HardwareTriggered);
    match lines.finish() {
        Ok(board) => {
            if board.resets > 0 {
                sync.notes.push(format!("the board was reset {} times; the longest run counts", board.resets));
            }
            // The first line may be half a line.
            if board.damaged_lines > 1 {
                sync.notes.push(format!("{} lines were damaged", board.damaged_lines));
            }
            match board.uncertainty_ns {
                Some(half) => sync.notes.push(format!("common to all triggered streams: ±{:.0} µs", half / 1000.0)),
                None => {
                    sync.notes.push("no `clock` commands: the board's clock is late by the line's least delay".into())
                }
            }
            sync.clock = Some(board.clock.clone());
            (Some(board), sync)
        }
        Err(error) => {
            sync.notes.push(error.to_string());
            (None, sync)
        }
    }
}

fn fit_events(id: &str, events: &Events, board: Option<&Board>) -> StreamSync {
    let mut sync = empty(id, Tier::FreeRunning);
    if events.decoder.is_none() {
        sync.notes.push("erfgs cannot decode the stream".into());
    }
    if events.sink.discontinuities > 0 {
        sync.notes.push(format!(
            "the time of the camera has {} breaks; one clock was fitted across them",
            events.sink.discontinuities
        ));
    }
    let samples = match board.map(|board| edges::fit(&events.sink.edges, board)) {
        Some(Ok((clock, matched, samples))) => {
            sync.tier = Tier::HardwareTriggered;
            (sync.clock, sync.matched) = (Some(clock), Some(matched));
            samples
        }
        failed => {
            if failed.is_some() {
                let seen = events.sink.edges.len();
                sync.notes.push(format!("{seen} edges, and none matched a pulse: check the wire to the trigger input"));
            }
            match edges::fit_arrivals(&events.arrivals) {
                Ok(clock) => sync.clock = Some(clock),
                Err(error) => sync.notes.push(error.to_string()),
            }
            events.arrivals.clone()
        }
    };
    if let Some(clock) = &sync.clock {
        let step = samples.len().div_ceil(MAX_POINTS).max(1);
        let point = |sample: &Sample| (clock.session_ns(sample.ticks) as f64 * 1e-9, clock.distance_ns(sample));
        sync.points = samples.iter().step_by(step).map(point).collect();
    }
    sync
}

fn fit_frames(description: &Description, arrived: &[Arrived], board: Option<&Board>) -> StreamSync {
    let mut sync = empty(&description.id, Tier::FreeRunning);
    let setting = |name: &str| description.settings.get(name).and_then(serde_json::Value::as_f64);
    let exposure_ns = setting("exposure_us").map(|exposure| (exposure * 1000.0) as i64);
    let triggered = description.settings.get("triggered").and_then(serde_json::Value::as_bool);
    if let (Some(board), Some(true)) = (board, triggered) {
        let exposures = frames::match_pulses(arrived, board, exposure_ns);
        if exposures.pulse.is_empty() {
            sync.notes.push("no frame matched a pulse: check the wire to the camera's trigger".into());
        } else {
            sync.tier = Tier::HardwareTriggered;
            sync.exposures = Some(exposures);
        }
    }
    if sync.exposures.is_none() && !arrived.is_empty() {
        sync.notes.push("the middles of the exposures may all be off by up to a frame; a flash tells (tier C)".into());
        sync.exposures = Some(frames::free_running(arrived, exposure_ns));
    }
    if let Some(exposures) = &sync.exposures {
        let stamps: BTreeMap<u64, i64> = arrived.iter().map(|frame| (frame.sequence, frame.stamp_ns)).collect();
        let step = exposures.sequence.len().div_ceil(MAX_POINTS).max(1);
        sync.points = std::iter::zip(&exposures.sequence, &exposures.mid_ns)
            .step_by(step)
            .filter_map(|(sequence, &mid)| {
                let stamp = stamps.get(sequence)?;
                Some((mid as f64 * 1e-9, (stamp - mid - exposures.lag_ns) as f64))
            })
            .collect();
    }
    sync
}
