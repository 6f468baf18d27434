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
    lamp::{Counts, Lamp, brightness},
    report::{StreamSync, Synchronisation, Tier, VERSION},
};

/// A plot of more points than this shows no more.
const MAX_POINTS: usize = 4000;

/// What to look for in a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SyncOptions {
    /// Look for the flashes of a lamp that event cameras and free-running cameras saw, which gives the lags of the
    /// latter (tier C). Every frame of those is decoded for it.
    pub flash: bool,
}

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
    /// If a lamp is looked for.
    counts: Option<Counts>,
}

impl Sink for Edges {
    fn event(&mut self, event: CdEvent) {
        self.last_us = Some(event.t_us);
        if let Some(counts) = &mut self.counts {
            counts.add(event.t_us, event.on);
        }
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.last_us = batch.t_us.last().copied().or(self.last_us);
        if let Some(counts) = &mut self.counts {
            std::iter::zip(batch.t_us, batch.on).for_each(|(&t_us, &on)| counts.add(t_us, on));
        }
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

/// What is gathered of a frame camera.
#[derive(Default)]
struct Frames {
    arrived: Vec<Arrived>,
    /// The mean level of each frame, if a lamp is looked for.
    brightness: Option<Vec<Option<f64>>>,
}

enum Gathered {
    Events(Box<Events>),
    Frames(Frames),
    Board(BoardLines),
}

/// Reads a session through and fits all its clocks. `progress` is called with the bytes of payload read so far.
///
/// # Errors
/// If the session cannot be read. Damaged places are passed over; the session's summary tells them.
pub fn synchronise<R: Read + Seek>(
    session: &mut Session<R>,
    options: SyncOptions,
    mut progress: impl FnMut(u64),
) -> Result<Synchronisation, ContainerError> {
    let streams = session.summary().streams.clone();
    let start_ns = session.summary().start.host_ns;
    let mut gathered: Vec<Gathered> = streams.iter().map(|stream| gather(&stream.description, options)).collect();
    let mut bytes = 0;
    for entry in session.messages(None) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) => (stream, packet),
            Err(error @ (ContainerError::Read { .. } | ContainerError::Compression { .. })) => return Err(error),
            Ok(_) | Err(_) => continue,
        };
        bytes += packet.payload.len() as u64;
        if let (Some(gathered), Some(stream)) = (gathered.get_mut(stream), streams.get(stream)) {
            gathered.take(&stream.description, &packet, start_ns);
        }
        progress(bytes);
    }
    let name = session.path().file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(Synchronisation { version: VERSION, session: name, streams: fit_all(&streams, gathered) })
}

fn gather(description: &Description, options: SyncOptions) -> Gathered {
    match description.encoding {
        Encoding::TriggerLines => Gathered::Board(BoardLines::default()),
        encoding if encoding.is_events() => Gathered::Events(Box::new(Events {
            decoder: StreamDecoder::new(encoding, sensor_size(description)),
            sink: Edges { counts: options.flash.then(Counts::default), ..Edges::default() },
            arrivals: Vec::new(),
        })),
        _ => {
            let looks = options.flash && !is_triggered(description);
            Gathered::Frames(Frames { arrived: Vec::new(), brightness: looks.then(Vec::new) })
        }
    }
}

fn is_triggered(description: &Description) -> bool {
    description.settings.get("triggered").and_then(serde_json::Value::as_bool) == Some(true)
}

impl Gathered {
    fn take(&mut self, description: &Description, packet: &Packet, start_ns: i64) {
        let arrival_ns = packet.host_ns.saturating_sub(start_ns);
        match self {
            Self::Board(lines) => lines.take(packet, start_ns),
            Self::Frames(frames) => {
                let stamp = packet.stamp.filter(|stamp| stamp.clock == StampClock::Monotonic);
                let stamp_ns = stamp.map_or(arrival_ns, |stamp| stamp.kernel_ns.saturating_sub(start_ns));
                frames.arrived.push(Arrived { sequence: packet.sequence, stamp_ns });
                if let Some(levels) = &mut frames.brightness {
                    levels.push(brightness(description, &packet.payload));
                }
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
    let mut frame_cameras = Vec::new();
    let mut lamps: Vec<(Tier, Lamp)> = Vec::new();
    for (stream, gathered) in others {
        match gathered {
            Gathered::Events(events) => {
                let sync = fit_events(&stream.description.id, &events, board.as_ref());
                let lit = |counts: &Counts| counts.lit(sync.clock.as_ref()?);
                if let Some(lit) = events.sink.counts.as_ref().and_then(lit) {
                    lamps.push((sync.tier, Lamp { seen_by: sync.id.clone(), lit }));
                }
                found.insert(sync.id.clone(), sync);
            }
            Gathered::Frames(frames) => frame_cameras.push((stream, frames)),
            Gathered::Board(_) => {}
        }
    }
    // The best clock tells best when the lamp was lit.
    let lamp = lamps.into_iter().min_by_key(|(tier, _)| *tier).map(|(_, lamp)| lamp);
    for (stream, frames) in frame_cameras {
        let sync = fit_frames(&stream.description, &frames, board.as_ref(), lamp.as_ref());
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

fn fit_frames(description: &Description, frames: &Frames, board: Option<&Board>, lamp: Option<&Lamp>) -> StreamSync {
    let mut sync = empty(&description.id, Tier::FreeRunning);
    let arrived = &frames.arrived[..];
    let exposure_us = description.settings.get("exposure_us").and_then(serde_json::Value::as_f64);
    let exposure_ns = exposure_us.map(|exposure| (exposure * 1000.0) as i64);
    if let (Some(board), true) = (board, is_triggered(description)) {
        let exposures = frames::match_pulses(arrived, board, exposure_ns);
        if exposures.pulse.is_empty() {
            sync.notes.push("no frame matched a pulse: check the wire to the camera's trigger".into());
        } else {
            sync.tier = Tier::HardwareTriggered;
            sync.exposures = Some(exposures);
        }
    }
    if sync.exposures.is_none() && !arrived.is_empty() {
        match flash_of(frames, lamp, exposure_ns) {
            Some(Ok((lag_ns, note))) => {
                sync.tier = Tier::Flash;
                sync.notes.push(note);
                sync.exposures = Some(frames::lagging(arrived, lag_ns, exposure_ns));
            }
            failed => {
                sync.notes.push(match failed {
                    Some(Err(note)) => note,
                    _ => "the middles of the exposures may all be off by up to a frame; a flash tells (--flash)".into(),
                });
                sync.exposures = Some(frames::free_running(arrived, exposure_ns));
            }
        }
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

/// The lag that a flash tells and how it was found, or why it tells none; `None` if no lamp was looked for.
fn flash_of(frames: &Frames, lamp: Option<&Lamp>, exposure_ns: Option<i64>) -> Option<Result<(i64, String), String>> {
    let brightness = frames.brightness.as_ref()?;
    let Some(lamp) = lamp else {
        return Some(Err(
            "no event camera saw a lamp flash three times: the middles may be off by up to a frame".into()
        ));
    };
    let Some(found) = lamp.lag(&frames.arrived, brightness, exposure_ns) else {
        return Some(Err(format!(
            "its brightness does not follow the {} flashes that {} saw: the middles may be off by up to a frame",
            lamp.lit.len(),
            lamp.seen_by
        )));
    };
    let ms = |ns: i64| ns as f64 * 1e-6;
    let note = format!(
        "{} flashes that {} saw tell a lag of {:.2} ms (±{:.2} ms, correlation {:.3})",
        lamp.lit.len(),
        lamp.seen_by,
        ms(found.lag_ns),
        ms(found.width_ns) / 2.0,
        found.correlation
    );
    Some(Ok((found.lag_ns, note)))
}
