//! Clocks of emulated cameras against what only the emulation knows: crystals that are off and drift, one way in the camera
//! and the other way in the board, transfers that are late, cables that are pulled.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::{Arc, Mutex},
    time::Duration,
};

use crate::usb_cameras::support::{Bucket, Clock, EmulatedBus, davis346::events_only, simulated};
use erfgs_base::random;
use erfgs_events::{CdEvent, Edge, Sink};
use erfgs_hardware_mocks::{
    trigger::{self, Line},
    usb::{
        Davis346, Davis346Options, Evk4, Evk4Options, Fault, FaultKind, Faults, Plug, TriggerLine,
        clock::ClockError,
        evk4::Stimulus,
        scene::{Pattern, PatternFrames},
    },
};
use erfgs_rig::event::{Davis346Source, Evk4Config, Evk4Source};
use erfgs_session::trigger::protocol::Command;
use erfgs_session::{
    clock::{EpochCursor, Residuals},
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, Incident, Packet, Source},
};
use erfgs_sync::{BoardLines, Bounds, StreamSync, SyncOptions, Tier, synchronise};

/// Where the bus's time begins, and the session's.
const START_NS: i64 = 1_000_000_000;
const SECONDS: i64 = 40;
/// When the cable is out, milliseconds from the first transfer on.
const OUT_MS: (u64, u64) = (18_000, 1500);
/// From an edge to the arrival of the packet that tells it, at most.
const LATE_NS: i64 = 15_000_000;

/// A simulated clock that rests once in sixteen milliseconds, as nobody here looks at a camera before the end.
struct Hurried(Arc<dyn Clock>);

impl Clock for Hurried {
    fn now_ns(&self) -> i64 {
        self.0.now_ns()
    }

    fn pass(&self, duration: Duration) {
        self.0.pass(duration);
    }

    fn rest(&self) {
        if self.now_ns() / 1_000_000 % 16 == 0 {
            self.0.rest();
        }
    }
}

fn hurried() -> Arc<dyn Clock> {
    Arc::new(Hurried(simulated()))
}

fn packet(sequence: u64, host_ns: i64, bytes: Vec<u8>) -> Packet {
    Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload: bytes.into() }
}

/// What the board says and the edges that it gives, true times: 100 ppm fast, and faster each minute.
fn board() -> (Vec<Packet>, Vec<(i64, bool)>) {
    let clock = trigger::Clock { ppm: 100.0, drift_ppm_per_minute: 1.0 };
    let mut board = trigger::Board::new(clock, trigger::Faults::default(), START_NS);
    let (mut packets, mut asked): (Vec<Packet>, BTreeMap<i64, Vec<u8>>) = (Vec::new(), BTreeMap::new());
    asked.insert(START_NS + 400_000_000, Command::Start.encode());
    for second in 0..SECONDS {
        let sent = START_NS + second * 1_000_000_000 + 700_000_000;
        let text = Command::Clock(sent.cast_unsigned()).encode();
        asked.insert(sent + text.len() as i64 * 20_000 + 70_000, text);
    }
    for step in 0..SECONDS * 10_000 {
        let now = START_NS + step * 100_000;
        board.advance(now);
        while let Some(entry) = asked.first_entry().filter(|entry| *entry.key() <= now) {
            let (at, text) = entry.remove_entry();
            board.receive(&text, at);
        }
        let output = board.take_output();
        if !output.is_empty() {
            let n = packets.len() as u64;
            let late = -200_000.0 * random::range(random::key(8, &[n]), 1e-9, 1.0).ln();
            let arrived = now + output.len() as i64 * 20_000 + 80_000 + late as i64;
            let arrived = packets.last().map_or(arrived, |before| before.host_ns.max(arrived));
            packets.push(packet(n, arrived, output));
        }
    }
    let edges = board.take_edges().into_iter().filter(|edge| edge.line == Line::Events);
    (packets, edges.map(|edge| (edge.at_ns, edge.rising)).collect())
}

fn wire(edges: &[(i64, bool)]) -> TriggerLine {
    let line = TriggerLine::new();
    edges.iter().for_each(|&(at_ns, rising)| line.push(at_ns, rising));
    line
}

/// A sensor that is 100 ppm slow and becomes slower, and whose transfers are late.
fn faults() -> Faults {
    let clock = ClockError { offset_ppm: -100.0, drift_ppm_per_min: -1.0, ..ClockError::default() };
    Faults { clock, jitter_mean_us: 300.0, jitter_seed: 5, ..Faults::default() }
}

fn cable(pulled: bool) -> Faults {
    let (at_ms, for_ms) = OUT_MS;
    let schedule = if pulled { vec![Fault { at_ms, kind: FaultKind::Unplug { for_ms } }] } else { Vec::new() };
    Faults { schedule, ..Faults::default() }
}

/// Lets a camera run until the end.
fn record(clock: &dyn Clock, mut source: impl Source) -> (Description, Vec<Packet>) {
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    let end = START_NS + (SECONDS - 1) * 1_000_000_000;
    bucket.wait_until("the end", |bucket| {
        // While the cable is out nothing else moves the clock.
        if matches!(bucket.incidents().last(), Some(Incident::Lost { .. })) {
            clock.pass(Duration::from_millis(1));
        }
        bucket.packets.lock().unwrap().last().is_some_and(|packet| packet.host_ns > end)
    });
    source.stop().unwrap();
    let packets = std::mem::take(&mut *bucket.packets.lock().unwrap());
    (source.description().clone(), packets)
}

fn evk4(edges: &[(i64, bool)], pulled: bool) -> (Description, Vec<Packet>) {
    let options = Evk4Options { trigger: wire(edges), faults: faults(), ..Evk4Options::default() };
    let scene = Stimulus::Scene(Box::new(Pattern::new(1280, 720, 2000)));
    let clock = hurried();
    let bus = Arc::new(EmulatedBus::new(clock.clone()));
    bus.add(Arc::new(Mutex::new(Plug::new(Evk4::new(options, scene), &cable(pulled)))));
    record(&*clock, Evk4Source::open(bus, "camera", Evk4Config::default()).unwrap())
}

fn davis(edges: &[(i64, bool)], pulled: bool) -> (Description, Vec<Packet>) {
    let options = Davis346Options { trigger: wire(edges), faults: faults(), ..Davis346Options::default() };
    let scene = Box::new(Pattern::new(346, 260, 2000));
    let model = Davis346::new(options, scene, Box::new(PatternFrames::new()));
    let clock = hurried();
    let bus = Arc::new(EmulatedBus::new(clock.clone()));
    bus.add(Arc::new(Mutex::new(Plug::new(model, &cable(pulled)))));
    record(&*clock, Davis346Source::open(bus, "camera", events_only()).unwrap())
}

/// The session times of all edges, and the packets that told them.
struct Dates<'a> {
    cursor: EpochCursor<'a>,
    sequence: u64,
    edges: Vec<(u64, i64, bool)>,
}

impl Sink for Dates<'_> {
    fn packet(&mut self, sequence: u64) {
        self.sequence = sequence;
        self.cursor.packet(sequence);
    }

    fn discontinuity(&mut self, _t_us: u64) {
        self.cursor.discontinuity();
    }

    fn event(&mut self, _event: CdEvent) {}

    fn edge(&mut self, edge: Edge) {
        let at_ns = self.cursor.session_ns(edge.t_us).expect("every edge is dated");
        self.edges.push((self.sequence, at_ns, edge.rising));
    }
}

fn write(path: &Path, camera: &(Description, Vec<Packet>), lines: &[Packet]) {
    let start = SessionStart { host_ns: START_NS, ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    let stream = writer.add_stream(&camera.0).unwrap();
    let (id, encoding) = ("board".to_owned(), Encoding::TriggerLines);
    let board = Description { id, encoding, width: 0, height: 0, ..camera.0.clone() };
    let board = writer.add_stream(&board).unwrap();
    camera.1.iter().for_each(|packet| writer.packet(stream, packet).unwrap());
    lines.iter().for_each(|packet| writer.packet(board, packet).unwrap());
    writer.finish().unwrap();
}

/// For each edge that the camera saw, by its true time: how much later the session's clock says it was.
fn errors(
    camera: &(Description, Vec<Packet>),
    lines: &[Packet],
    edges: &[(i64, bool)],
) -> (StreamSync, BTreeMap<i64, i64>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    write(&path, camera, lines);
    let mut session = Session::open(&path).unwrap();
    let sync = synchronise(&mut session, SyncOptions::default(), |_| {}).unwrap().stream("camera").unwrap().clone();
    let mut dates = Dates { cursor: sync.epochs.follow(), sequence: 0, edges: Vec::new() };
    session.decode_events(0, None, &mut dates, |_| {}).unwrap();
    let arrived: BTreeMap<u64, i64> = camera.1.iter().map(|packet| (packet.sequence, packet.host_ns)).collect();
    let mut before = None;
    let found = dates.edges.iter().map(|&(sequence, at_ns, rising)| {
        // The only edge that the packet can have told: pulses are twice as far apart. Where it was later, since this machine is busy, it
        // told the edge after the one before.
        let window = arrived[&sequence] - LATE_NS..arrived[&sequence];
        let within = |&at: &usize| edges[at].1 == rising && window.contains(&edges[at].0);
        let matching: Vec<usize> = (0..edges.len()).filter(within).collect();
        assert!(matching.len() <= 1, "packet {sequence}");
        let edge = matching.first().copied().or(before.map(|before: usize| before + 1)).expect("an edge");
        assert_eq!(edges[edge].1, rising, "packet {sequence}");
        before = Some(edge);
        (edges[edge].0, at_ns + START_NS - edges[edge].0)
    });
    (sync.clone(), found.collect())
}

/// How far edges are off, in nanoseconds.
fn off(errors: &BTreeMap<i64, i64>) -> Residuals {
    Residuals::of(errors.values().map(|error| error.abs() as f64).collect())
}

fn uncertainty_ns(lines: &[Packet]) -> f64 {
    let mut board = BoardLines::default();
    lines.iter().for_each(|packet| board.take(packet, START_NS));
    let board = board.finish().unwrap();
    let Bounds::Within { half_ns } = board.bounds else { panic!("{:?}", board.bounds) };
    half_ns
}

#[test]
fn triggered_cameras_are_within_2_us_of_each_other_and_of_the_truth_to_what_the_board_says() {
    let (lines, edges) = board();
    let board_ns = uncertainty_ns(&lines);
    assert!(board_ns < 150_000.0, "{board_ns}");
    let cameras = [evk4(&edges, false), davis(&edges, false)];
    let [left, right] = cameras.each_ref().map(|camera| {
        let (sync, errors) = errors(camera, &lines, &edges);
        assert_eq!((sync.tier, sync.epochs.as_slice().len()), (Tier::HardwareTriggered, 1), "{:?}", sync.notes);
        let off = off(&errors);
        println!("{}: {off:?} from the truth, the board says ±{board_ns} ns", camera.0.model);
        assert!(off.p95_ns < board_ns + 2_000.0, "{off:?}, the board says {board_ns}");
        errors
    });
    let apart = left.iter().filter_map(|(at, error)| Some((error - right.get(at)?).abs() as f64)).collect::<Vec<f64>>();
    assert!(apart.len() > 2000, "{}", apart.len());
    let apart = Residuals::of(apart);
    println!("apart: {apart:?}");
    assert!(apart.p95_ns < 2_000.0, "{apart:?}");
}

#[test]
fn cameras_that_were_replugged_are_dated_on_both_sides() {
    let (lines, edges) = board();
    let board_ns = uncertainty_ns(&lines);
    let out = START_NS + 1_000_000 * OUT_MS.0 as i64;
    // Without the board, arrivals date: no fit can find their least delay, which is one or two milliseconds on this bus.
    for camera in [evk4(&edges, true), davis(&edges, true)] {
        let model = &camera.0.model;
        for (lines, tier, limit) in
            [(&lines[..], Tier::HardwareTriggered, board_ns + 2_000.0), (&[], Tier::FreeRunning, 2_000_000.0)]
        {
            let (sync, errors) = errors(&camera, lines, &edges);
            assert_eq!((sync.tier, sync.epochs.as_slice().len()), (tier, 2), "{model}: {:?}", sync.notes);
            let sides = [errors.range(..out).count(), errors.range(out + 5_000_000_000..).count()];
            assert!(sides.iter().all(|&edges| edges > 300), "{model}: {sides:?}");
            let off = off(&errors);
            println!("{model}, {}: {off:?} from the truth", tier.name());
            assert!(off.p95_ns < limit && off.max_ns < limit + 10_000.0, "{model}: {off:?}");
        }
    }
}
