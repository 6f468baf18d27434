//! The EVK4's driver against the emulated camera, in this process.

use std::{
    io::Write,
    sync::{Arc, Mutex, atomic::Ordering},
};

use crate::usb_cameras::support::{
    Bucket, EmulatedBus,
    evk4::{Camera, assert_complete, decode, model, one, open, record, register},
};
use erfgs_events::EventEncoding;
use erfgs_hardware_mocks::usb::{
    Evk4 as Model, Evk4Options, Fault, FaultKind, Reply, Speed, TriggerLine, Urb, UsbDevice,
    clock::SyncWire,
    evk4::{REPLIES, STREAM},
    line::PulseTrain,
};
use erfgs_rig::event::{
    EventError, Evk4Config, Kind,
    evk4::{BiasOffsets, Format, SyncRole},
    list_on,
};
use erfgs_rig::usb::Fault as UsbFault;
use erfgs_session::source::{Incident, Source};

#[derive(Clone, Default)]
struct Copy(Arc<Mutex<Vec<u8>>>);

impl Write for Copy {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn every_byte_and_every_event_arrives_in_both_formats() {
    for (format, encoding) in [(Format::Evt3, EventEncoding::Evt3), (Format::Evt21, EventEncoding::Evt21Legacy)] {
        let (bus, camera) = one(Evk4Options::default(), Vec::new());
        let sent = Copy::default();
        let copy = sent.clone();
        camera
            .lock()
            .unwrap()
            .ledger()
            .keep(move |_, endpoint| (endpoint == STREAM).then(|| Box::new(copy.clone()) as Box<dyn Write + Send>));
        let mut source = open(&bus, Evk4Config { format, ..Evk4Config::default() }).unwrap();
        assert_eq!(source.description().encoding, encoding.into());
        assert_eq!((source.description().width, source.description().height), (1280, 720));
        let bucket = record(&mut source, 500_000);
        assert!(bucket.bytes() == *sent.0.lock().unwrap(), "bytes differ");
        let packets = bucket.packets.lock().unwrap();
        for (packet, sequence) in packets.iter().zip(0..) {
            assert_eq!((packet.sequence, packet.discontinuity, packet.damaged), (sequence, false, false));
        }
        assert!(packets.is_sorted_by_key(|packet| packet.host_ns));
        let counters = source.counters();
        assert_eq!(counters.packets, packets.len() as u64);
        assert_eq!(counters.bytes, sent.0.lock().unwrap().len() as u64);
        assert_eq!((counters.refused, counters.errors, counters.lost), (0, 0, 0));
        drop(packets);
        let runs = decode(&bucket, encoding);
        assert_eq!(runs.len(), 1);
        assert!(runs[0].events.len() > 50_000, "{} events", runs[0].events.len());
        assert_complete(&runs[0]);
        assert_eq!(bucket.incidents(), []);
    }
}

#[test]
fn a_source_starts_again_after_it_was_stopped() {
    let (bus, _camera) = one(Evk4Options::default(), Vec::new());
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    for _ in 0..2 {
        let bucket = record(&mut source, 50_000);
        assert_eq!(bucket.packets.lock().unwrap()[0].sequence, 0);
        decode(&bucket, EventEncoding::Evt3).iter().for_each(assert_complete);
    }
    source.stop().unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    assert!(source.start(bucket).unwrap_err().to_string().contains("already streaming"));
}

#[test]
fn the_camera_measures_its_temperature_while_it_streams() {
    let (bus, _camera) = one(Evk4Options { temperature_c: 37.5, ..Evk4Options::default() }, Vec::new());
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(10_000);
    let readings: std::collections::BTreeMap<_, _> = source.readings().into_iter().collect();
    assert!((readings["temperature_celsius"] - 37.5).abs() < 0.1, "{readings:?}");
    assert!(readings["illuminance_lux"] > 0.0);
}

#[test]
fn a_board_that_takes_one_register_a_frame_gets_the_same_tables() {
    let (bus, camera) = one(Evk4Options { burst_writes: false, ..Evk4Options::default() }, Vec::new());
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    assert_eq!(source.description().settings["burst_writes"], false);
    for step in 0..256 {
        assert_eq!(register(&camera, 0x6400 + 4 * step), ((2 * step + 1) << 16) | (2 * step));
    }
    assert_complete(&decode(&record(&mut source, 20_000), EventEncoding::Evt3)[0]);
}

/// A camera whose stream has run for a while when the fault comes: opening takes about 2.7 s of its time.
const STREAMING_MS: u64 = 3500;

fn with_fault(kind: FaultKind) -> (Arc<EmulatedBus>, Camera) {
    one(Evk4Options::default(), vec![Fault { at_ms: STREAMING_MS, kind }])
}

fn faults(camera: &Camera) -> u64 {
    camera.lock().unwrap().ledger().lock().faults
}

#[test]
fn a_halted_endpoint_is_cleared_and_the_gap_marked() {
    let (bus, camera) = with_fault(FaultKind::Stall { endpoint: STREAM });
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_until("a warning", |bucket| !bucket.incidents().is_empty());
    bucket.wait_for_bytes(50_000);
    source.stop().unwrap();
    assert_eq!(faults(&camera), 1);
    assert!(matches!(&bucket.incidents()[..], [Incident::Warning { message }] if message.contains("halted")));
    assert_eq!((source.counters().errors, source.counters().reconnections), (1, 0));
    let runs = decode(&bucket, EventEncoding::Evt3);
    assert_eq!(runs.len(), 2);
    // The camera lost nothing here, so that the second run goes on where the first ended (a decoder that starts anew
    // waits for the first full time stamp).
    runs.iter().for_each(assert_complete);
}

#[test]
fn transfers_cut_at_any_byte_lose_nothing() {
    let cuts = (1..60).map(|bytes| Fault {
        at_ms: STREAMING_MS + bytes * 10,
        kind: FaultKind::ShortRead { endpoint: STREAM, bytes: bytes as usize, lost: false },
    });
    let (bus, camera) = one(Evk4Options::default(), cuts.collect());
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_until("all cuts", |_| faults(&camera) == 59);
    bucket.wait_for_bytes(20_000);
    source.stop().unwrap();
    let runs = decode(&bucket, EventEncoding::Evt3);
    assert_eq!((runs.len(), bucket.incidents().len()), (1, 0));
    assert_complete(&runs[0]);
}

#[test]
fn an_endpoint_that_is_silent_for_a_second_delays_and_loses_nothing() {
    let (bus, camera) = with_fault(FaultKind::Nak { endpoint: STREAM, for_ms: 1000 });
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_until("the pause", |_| faults(&camera) == 1);
    bucket.wait_for_bytes(400_000);
    source.stop().unwrap();
    let runs = decode(&bucket, EventEncoding::Evt3);
    assert_eq!(runs.len(), 1);
    assert_complete(&runs[0]);
}

#[test]
fn a_slow_answer_is_waited_for_and_a_missing_one_is_an_error_that_names_the_register() {
    let slow = Fault { at_ms: 100, kind: FaultKind::Nak { endpoint: REPLIES, for_ms: 8000 } };
    let (bus, _camera) = one(Evk4Options::default(), vec![slow]);
    open(&bus, Evk4Config::default()).unwrap();
    let missing = Fault { at_ms: 100, kind: FaultKind::Nak { endpoint: REPLIES, for_ms: 60_000 } };
    let (bus, _camera) = one(Evk4Options::default(), vec![missing]);
    let error = open(&bus, Evk4Config::default()).err().unwrap();
    assert_eq!(error.fault(), Some(&UsbFault::Timeout));
    let text = error.to_string();
    assert!(text.contains("register 0x") && text.contains("00051234") && text.contains("Unplug"), "{text}");
}

#[test]
fn a_camera_that_is_plugged_in_again_gets_its_configuration_back() {
    let (bus, camera) = one(Evk4Options::default(), Vec::new());
    let biases = BiasOffsets { diff_on: 20, ..BiasOffsets::default() };
    let mut source = open(&bus, Evk4Config { biases, ..Evk4Config::default() }).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(50_000);
    camera.lock().unwrap().unplug();
    bucket.wait_until("the loss", |bucket| !bucket.incidents().is_empty());
    camera.lock().unwrap().plug();
    assert_ne!(register(&camera, 0x1010) & 0xFF, 0x69 + 20, "a fresh camera has its trim");
    bucket.wait_until("the return", |bucket| bucket.incidents().contains(&Incident::Back));
    bucket.wait_for_bytes(50_000);
    source.stop().unwrap();
    assert_eq!(register(&camera, 0x1010), 0x11A1_0000 | (0x69 + 20));
    let incidents = bucket.incidents();
    assert!(
        matches!(&incidents[..], [Incident::Lost { reason }, Incident::Back] if reason.contains("00051234")),
        "{incidents:?}"
    );
    assert_eq!(source.counters().reconnections, 1);
    let runs = decode(&bucket, EventEncoding::Evt3);
    assert_eq!(runs.len(), 2);
    runs.iter().for_each(assert_complete);
    // Every byte that left the camera is in one of the two runs.
    let ledger = camera.lock().unwrap().ledger();
    let sent: u64 = ledger.lock().sessions.iter().filter_map(|session| session.get(&STREAM)).map(|it| it.bytes).sum();
    assert_eq!(bucket.bytes().len() as u64, sent);
}

#[test]
fn another_camera_of_the_model_is_not_taken_for_the_lost_one() {
    let (bus, camera) = one(Evk4Options::default(), Vec::new());
    let other = Evk4Options { serial: 0xBEEF, ..Evk4Options::default() };
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(10_000);
    camera.lock().unwrap().unplug();
    bus.add(Arc::new(Mutex::new(model(other))));
    bucket.wait_until("the loss", |bucket| !bucket.incidents().is_empty());
    let looks = bus.looks.load(Ordering::SeqCst);
    bucket.wait_until("three more looks for the camera", |_| bus.looks.load(Ordering::SeqCst) >= looks + 3);
    assert!(!bucket.incidents().contains(&Incident::Back));
    camera.lock().unwrap().plug();
    bucket.wait_until("the return", |bucket| bucket.incidents().contains(&Incident::Back));
    source.stop().unwrap();
}

#[test]
fn a_source_that_is_stopped_while_its_camera_is_away_stops_and_starts_again_when_it_is_back() {
    let (bus, camera) = one(Evk4Options::default(), Vec::new());
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    camera.lock().unwrap().unplug();
    bucket.wait_until("the loss", |bucket| !bucket.incidents().is_empty());
    source.stop().unwrap();
    let error = source.start(bucket.clone()).unwrap_err().to_string();
    assert!(error.contains("00051234") && error.contains("found"), "{error}");
    camera.lock().unwrap().plug();
    record(&mut source, 10_000);
}

#[test]
fn two_cameras_are_told_apart_and_one_is_used_once() {
    let bus = Arc::new(EmulatedBus::default());
    for serial in [0x11, 0x22] {
        bus.add(Arc::new(Mutex::new(model(Evk4Options { serial, ..Evk4Options::default() }))));
    }
    let error = open(&bus, Evk4Config::default()).err().unwrap().to_string();
    assert!(error.contains("00000011") && error.contains("00000022"), "{error}");
    let with = |serial: &str| Evk4Config { serial: serial.into(), ..Evk4Config::default() };
    let source = open(&bus, with("00000022")).unwrap();
    assert_eq!(source.description().serial, "00000022");
    let error = open(&bus, with("00000022")).err().unwrap().to_string();
    assert!(error.contains("another program uses it") && error.contains("00000011"), "{error}");
    let error = open(&bus, with("00000033")).err().unwrap().to_string();
    assert!(error.contains("00000033"), "{error}");
    let listed = list_on(bus.as_ref()).unwrap();
    assert_eq!(listed.len(), 2);
    assert_eq!((listed[0].kind, listed[0].serial.as_str(), &listed[0].problem), (Kind::Evk4, "00000011", &None));
    assert!(listed[1].problem.as_ref().unwrap().contains("another program"));
    drop(source);
    assert_eq!(list_on(bus.as_ref()).unwrap()[1].problem, None);
}

/// Alters the answers of a camera.
struct Imposter(Model, &'static [u8], &'static [u8]);

impl UsbDevice for Imposter {
    fn speed(&self) -> Speed {
        self.0.speed()
    }

    fn submit(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        match self.0.submit(urb, now_ns) {
            Reply::Data(mut bytes) if urb.endpoint == REPLIES => {
                for at in 0..=bytes.len().saturating_sub(self.1.len()) {
                    if bytes[at..].starts_with(self.1) {
                        bytes[at..at + self.2.len()].copy_from_slice(self.2);
                    }
                }
                Reply::Data(bytes)
            }
            reply => reply,
        }
    }

    fn reset(&mut self) {
        self.0.reset();
    }
}

#[test]
fn a_board_with_another_sensor_is_refused_untouched() {
    for (from, to, named) in [
        (
            b"psee,ccam5_imx636\0psee,ccam5_gen42".as_slice(),
            b"psee,ccam5_gen41\0\0psee,ccam5_gen31".as_slice(),
            "gen41",
        ),
        (b"\x06\x18\x40\xA0", b"\x06\x18\x30\xA0", "0xa0301806"),
    ] {
        let bus = Arc::new(EmulatedBus::default());
        let imposter = Arc::new(Mutex::new(Imposter(model(Evk4Options::default()), from, to)));
        bus.add(imposter.clone());
        let error = open(&bus, Evk4Config::default()).err().unwrap();
        assert!(matches!(&error, EventError::WrongDevice { found, .. } if found.contains(named)), "{error}");
        assert_eq!(imposter.lock().unwrap().0.register(0xB000), 0, "nothing was written");
        assert_eq!(list_on(bus.as_ref()).unwrap()[0].kind, Kind::Unknown);
    }
}

#[test]
fn old_firmware_is_refused_with_its_version() {
    let (bus, _camera) = one(Evk4Options { release: 0x3_0700, ..Evk4Options::default() }, Vec::new());
    let error = open(&bus, Evk4Config::default()).err().unwrap().to_string();
    assert!(error.contains("3.7.0") && error.contains("3.8.0"), "{error}");
}

#[test]
fn refused_memory_is_told_with_advice() {
    let (bus, _camera) = one(Evk4Options::default(), Vec::new());
    bus.grants.store(5, Ordering::SeqCst);
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = record(&mut source, 10_000);
    let incidents = bucket.incidents();
    assert!(
        incidents.iter().any(|it| matches!(it, Incident::Warning { message }
            if message.contains("5 of") && message.contains("usbfs_memory_mb"))),
        "{incidents:?}"
    );
    assert_eq!(source.description().settings["stream"]["transfers"], 5);
    drop(source);
    bus.grants.store(0, Ordering::SeqCst);
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let error = source.start(Arc::new(Bucket::default())).unwrap_err().to_string();
    assert!(error.contains("usbfs_memory_mb"), "{error}");
}

#[test]
fn packets_that_the_outlet_refuses_are_counted_and_leave_a_marked_gap() {
    let (bus, _camera) = one(Evk4Options::default(), Vec::new());
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = Arc::new(Bucket::default());
    bucket.refuse.store(3, Ordering::SeqCst);
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(10_000);
    source.stop().unwrap();
    assert_eq!(source.counters().refused, 3);
    let packets = bucket.packets.lock().unwrap();
    assert_eq!((packets[0].sequence, packets[0].discontinuity, packets[1].discontinuity), (3, true, false));
}

#[test]
fn a_slave_and_its_master_see_an_edge_at_the_same_time() {
    let bus = Arc::new(EmulatedBus::default());
    let train = PulseTrain { first_ns: 5_000_000_000, period_ns: 10_000_000, high_ns: 2_000_000 };
    let (trigger, sync) = (TriggerLine::train(train), SyncWire::new());
    for (serial, offset_ppm) in [(1, 40.0), (2, -60.0)] {
        let mut options =
            Evk4Options { serial, trigger: trigger.clone(), sync: sync.clone(), ..Evk4Options::default() };
        options.faults.clock.offset_ppm = offset_ppm;
        bus.add(Arc::new(Mutex::new(model(options))));
    }
    let config = |serial: &str, sync| Evk4Config { serial: serial.into(), sync, ..Evk4Config::default() };
    let mut master = open(&bus, config("00000001", SyncRole::Master)).unwrap();
    let mut slave = open(&bus, config("00000002", SyncRole::Slave)).unwrap();
    assert!(slave.description().start_order < master.description().start_order);
    let buckets = [Arc::new(Bucket::default()), Arc::new(Bucket::default())];
    slave.start(buckets[1].clone()).unwrap();
    master.start(buckets[0].clone()).unwrap();
    let edges = |bucket: &Bucket| decode(bucket, EventEncoding::Evt3).remove(0).edges;
    for bucket in &buckets {
        bucket.wait_until("edges", |bucket| edges(bucket).len() >= 40);
    }
    slave.stop().unwrap();
    master.stop().unwrap();
    // Each may have started to look an edge or two before the other.
    let [ours, theirs] = buckets.each_ref().map(|bucket| edges(bucket));
    let common = ours.iter().filter(|edge| theirs.contains(edge)).count();
    assert!(common >= 30, "{common} edges in common of {} and {}", ours.len(), theirs.len());
    assert!(ours.iter().all(|edge| edge.channel == 0));
    assert!(ours.windows(2).all(|pair| pair[0].rising != pair[1].rising));
}
