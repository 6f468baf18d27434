//! What arrives of an emulated DAVIS346: every event, frame, inertial sample and edge.

use std::sync::{Arc, Mutex};

use crate::usb_cameras::support::{
    Bucket, EmulatedBus,
    davis346::{events_only, model, one, open, pattern},
};
use erfgs_events::EventEncoding;
use erfgs_events::{ApsFrame, CdEvent, Decoder, Edge, ImuSample, SensorSize, Sink, StreamDecoder};
use erfgs_hardware_mocks::usb::{
    Davis346Options, Fault, FaultKind, TriggerLine, clock::SyncWire, davis346::STREAM, line::PulseTrain,
};
use erfgs_rig::event::{
    Davis346Config, Davis346Source,
    davis346::{Frames, Timestamps},
};
use erfgs_session::source::Source;

#[derive(Default)]
struct Found {
    events: Vec<CdEvent>,
    edges: Vec<Edge>,
    imu: Vec<ImuSample>,
    frames: Vec<ApsFrame>,
}

impl Sink for Found {
    fn event(&mut self, event: CdEvent) {
        self.events.push(event);
    }

    fn edge(&mut self, edge: Edge) {
        self.edges.push(edge);
    }

    fn imu(&mut self, sample: ImuSample) {
        self.imu.push(sample);
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.frames.push(frame);
    }
}

fn decode(bucket: &Bucket) -> Vec<Found> {
    let decoder = || StreamDecoder::new(EventEncoding::Davis, Some(SensorSize { width: 346, height: 260 }));
    let mut runs = vec![Found::default()];
    let mut now = decoder();
    for packet in bucket.packets.lock().unwrap().iter() {
        if packet.discontinuity {
            now.finish(runs.last_mut().unwrap());
            now = decoder();
            runs.push(Found::default());
        }
        now.decode(&packet.payload, runs.last_mut().unwrap());
    }
    now.finish(runs.last_mut().unwrap());
    runs
}

fn assert_complete(run: &Found) {
    let pattern = pattern();
    assert!(run.events.len() > 1000, "{} events", run.events.len());
    let first = pattern.first_at(run.events[0].t_us);
    for (event, k) in run.events.iter().zip(first..) {
        assert_eq!(*event, pattern.event(k), "event {k}, from {first} on");
    }
}

fn record(source: &mut Davis346Source, bytes: usize) -> Arc<Bucket> {
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(bytes);
    source.stop().unwrap();
    bucket
}

#[test]
fn every_byte_and_every_event_arrives() {
    let (bus, camera) = one(Davis346Options::default(), Vec::new());
    let mut source = open(&bus, Davis346Config { timestamps: Timestamps::Keep, ..events_only() }).unwrap();
    let bucket = record(&mut source, 300_000);
    let ledger = camera.lock().unwrap().ledger();
    assert_eq!(ledger.lock().sessions[0][&STREAM].bytes, bucket.bytes().len() as u64);
    assert_eq!(source.counters().bytes, bucket.bytes().len() as u64);
    let runs = decode(&bucket);
    assert_eq!((runs.len(), bucket.incidents()), (1, Vec::new()));
    assert_complete(&runs[0]);
}

#[test]
fn a_recording_has_one_time_from_its_first_event_on() {
    let (bus, _camera) = one(Davis346Options::default(), Vec::new());
    let mut source = open(&bus, Davis346Config::default()).unwrap();
    let bucket = record(&mut source, 300_000);
    let bytes = bucket.bytes();
    let word = |of: fn(&[u8]) -> bool| bytes.chunks_exact(2).position(of);
    let (reset, time) = (word(|word| word == [1, 0]).unwrap(), word(|word| word[1] >= 0x80).unwrap());
    assert!(reset < time, "the clock was reset in word {reset}, after the first time in word {time}");
    let mut decoder = StreamDecoder::new(EventEncoding::Davis, Some(SensorSize { width: 346, height: 260 }));
    let mut found = Found::default();
    decoder.decode(&bytes, &mut found);
    assert_eq!((decoder.anomalies().discontinuities, decoder.anomalies().time_backward), (0, 0));
    assert!(found.events.len() > 1000 && found.events.is_sorted_by_key(|event| event.t_us));
    assert!(found.events[0].t_us < 20_000, "{:?}", found.events[0]);
}

#[test]
fn frames_and_inertial_samples_come_with_the_events() {
    let (bus, _camera) = one(Davis346Options::default(), Vec::new());
    let config = Davis346Config {
        frames: Frames { exposure_us: 3000, interval_us: 25_000, ..Frames::default() },
        timestamps: Timestamps::Keep,
        ..Davis346Config::default()
    };
    let mut source = open(&bus, config).unwrap();
    let bucket = record(&mut source, 4_000_000);
    let run = decode(&bucket).remove(0);
    assert!(run.frames.len() >= 5, "{} frames", run.frames.len());
    for frame in &run.frames {
        assert_eq!((frame.width, frame.height, frame.pixels.len()), (346, 260, 346 * 260));
        let exposure = frame.exposure_end_us - frame.exposure_start_us;
        assert!(exposure.abs_diff(3000) <= 1, "{exposure} µs");
    }
    for pair in run.frames.windows(2) {
        let interval = pair[1].exposure_start_us - pair[0].exposure_start_us;
        assert!(interval.abs_diff(25_000) <= 1, "{interval} µs");
    }
    for pair in run.imu.windows(2) {
        assert!((pair[1].t_us - pair[0].t_us).abs_diff(1000) <= 1);
    }
    assert!(run.imu.len() > 100, "{} samples", run.imu.len());
    assert!(!run.events.is_empty());
}

#[test]
fn edges_of_the_external_input_are_in_the_stream() {
    let train = PulseTrain { first_ns: 2_000_000_000, period_ns: 20_000_000, high_ns: 5_000_000 };
    let options = Davis346Options { trigger: TriggerLine::train(train), ..Davis346Options::default() };
    let (bus, _camera) = one(options, Vec::new());
    let mut source = open(&bus, Davis346Config { timestamps: Timestamps::Keep, ..events_only() }).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_until("edges", |bucket| decode(bucket)[0].edges.len() >= 20);
    source.stop().unwrap();
    let edges = decode(&bucket).remove(0).edges;
    for pair in edges.windows(2) {
        assert_ne!(pair[0].rising, pair[1].rising);
        let expected = if pair[0].rising { 5000 } else { 15_000 };
        assert!((pair[1].t_us - pair[0].t_us).abs_diff(expected) <= 1);
    }
}

#[test]
fn the_master_of_a_chain_resets_all_time_stamps_when_it_starts() {
    let bus = Arc::new(EmulatedBus::default());
    let (sync, trigger) = (
        SyncWire::new(),
        TriggerLine::train(PulseTrain { first_ns: 3_000_000_000, period_ns: 20_000_000, high_ns: 5_000_000 }),
    );
    for (serial, master) in [("M", true), ("S", false)] {
        bus.add(Arc::new(Mutex::new(model(Davis346Options {
            serial: serial.into(),
            master,
            sync: sync.clone(),
            trigger: trigger.clone(),
            ..Davis346Options::default()
        }))));
    }
    let config = |serial: &str| Davis346Config { serial: serial.into(), ..events_only() };
    let mut slave = open(&bus, config("S")).unwrap();
    let mut master = open(&bus, config("M")).unwrap();
    assert!(slave.description().start_order < master.description().start_order);
    assert_eq!(slave.description().settings["clock_master"], false);
    let buckets = [Arc::new(Bucket::default()), Arc::new(Bucket::default())];
    slave.start(buckets[0].clone()).unwrap();
    buckets[0].wait_for_bytes(1000);
    master.start(buckets[1].clone()).unwrap();
    // Time stamp reset is special word 1.
    for bucket in &buckets {
        bucket.wait_until("the reset", |bucket| bucket.bytes().chunks_exact(2).any(|word| word == [1, 0]));
        bucket.wait_for_bytes(200_000);
    }
    slave.stop().unwrap();
    master.stop().unwrap();
    let [ours, theirs] = buckets.each_ref().map(|bucket| decode(bucket).remove(0).edges);
    let common = ours.iter().filter(|edge| theirs.contains(edge)).count();
    assert!(common >= 10, "{common} edges in common of {} and {}", ours.len(), theirs.len());
}

#[test]
fn transfers_cut_at_any_byte_lose_nothing() {
    let cuts = (1..40).map(|bytes| Fault {
        at_ms: 1000 + bytes * 10,
        kind: FaultKind::ShortRead { endpoint: STREAM, bytes: bytes as usize, lost: false },
    });
    let (bus, camera) = one(Davis346Options::default(), cuts.collect());
    let mut source = open(&bus, Davis346Config { timestamps: Timestamps::Keep, ..events_only() }).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_until("all cuts", |_| camera.lock().unwrap().ledger().lock().faults == 39);
    bucket.wait_for_bytes(50_000);
    source.stop().unwrap();
    let runs = decode(&bucket);
    assert_eq!(runs.len(), 1);
    assert_complete(&runs[0]);
}
