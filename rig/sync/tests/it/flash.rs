//! The lag of a free-running camera, found in a session by a lamp that flashed before it and an event camera.

use std::path::Path;

use erfgs_events::EventEncoding;
use erfgs_events::{CdEvent, Evt2Encoder};
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint},
};
use erfgs_sync::{StreamSync, SyncOptions, Tier, synchronise};

const START_NS: i64 = 40_000_000_000_000;
const MS: i64 = 1_000_000;
/// The event camera's clock at the session's start, microseconds.
const BEHIND_US: i64 = 3_000_000;
const SECONDS: i64 = 12;
const LAG_NS: i64 = 23 * MS;
const EXPOSURE_NS: i64 = 8 * MS;

/// The lamp is lit for 40 ms of 113 ms: its changes fall on all phases of a frame.
fn lit(session_ns: i64) -> bool {
    session_ns.rem_euclid(113 * MS) < 40 * MS
}

fn description(id: &str, encoding: Encoding, settings: serde_json::Value) -> Description {
    let settings = settings.as_object().unwrap().clone();
    Description {
        id: id.into(),
        model: "simulated".into(),
        serial: String::new(),
        encoding,
        width: 16,
        height: 16,
        start_order: 0,
        settings,
    }
}

fn packet(sequence: u64, host_ns: i64, stamp: Option<FrameStamp>, payload: Vec<u8>) -> Packet {
    Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp, payload: payload.into() }
}

/// Ten milliseconds of events: thousands where the lamp changes, some tens else.
fn events(encoder: &mut Evt2Encoder, from_ns: i64) -> Vec<u8> {
    let mut out = Vec::new();
    for step in 0..100_i64 {
        let ns = from_ns + step * MS / 10;
        let (before, now) = (lit(ns - MS / 10), lit(ns));
        let count = if before == now { 3 } else { 200 };
        for n in 0..count {
            let on = if before == now { n % 2 == 0 } else { now };
            let t_us = (ns / 1000 + BEHIND_US).unsigned_abs();
            encoder.event(CdEvent { t_us, x: n % 16, y: n / 16, on }, &mut out).unwrap();
        }
    }
    out
}

/// A frame as bright as the lamp was lit during its exposure.
fn frame(mid_ns: i64) -> Vec<u8> {
    let shown = (0..200).filter(|part| lit(mid_ns - EXPOSURE_NS / 2 + EXPOSURE_NS * part / 200)).count();
    vec![20 + shown as u8; 256]
}

fn write(path: &Path, camera_sees_the_lamp: bool) {
    let start = SessionStart { host_ns: START_NS, ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    let settings = serde_json::json!({ "exposure_us": EXPOSURE_NS as f64 / 1000.0, "triggered": false });
    let eye =
        writer.add_stream(&description("eye", Encoding::Events(EventEncoding::Evt2), serde_json::json!({}))).unwrap();
    let camera = writer.add_stream(&description("camera", Encoding::Frames(PixelFormat::Grey8), settings)).unwrap();
    let mut encoder = Evt2Encoder::default();
    for n in 0..SECONDS * 100 {
        let from_ns = n * 10 * MS;
        let arrival = START_NS + from_ns + 10 * MS + n * 7919 % 200_000;
        writer.packet(eye, &packet(n as u64, arrival, None, events(&mut encoder, from_ns))).unwrap();
    }
    for n in 0..SECONDS * 30 - 2 {
        let mid_ns = 20 * MS + n * 33_366_700;
        let kernel_ns = START_NS + mid_ns + LAG_NS;
        let stamp =
            FrameStamp { kernel_ns, clock: StampClock::Monotonic, point: StampPoint::EndOfFrame, sequence: n as u32 };
        let pixels = if camera_sees_the_lamp { frame(mid_ns) } else { vec![90; 256] };
        writer.packet(camera, &packet(n as u64, kernel_ns + MS, Some(stamp), pixels)).unwrap();
    }
    writer.finish().unwrap();
}

/// The free-running camera of such a session, fitted.
fn camera(sees_the_lamp: bool, flash: bool) -> StreamSync {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    write(&path, sees_the_lamp);
    let sync = synchronise(&mut Session::open(&path).unwrap(), SyncOptions { flash }, |_| {}).unwrap();
    sync.stream("camera").unwrap().clone()
}

#[test]
fn a_lamp_that_both_saw_tells_the_lag() {
    let seen = camera(true, true);
    assert_eq!(seen.tier, Tier::Flash, "{:?}", seen.notes);
    let exposures = seen.exposures.unwrap();
    assert!((exposures.lag_ns - LAG_NS).abs() < MS, "{} of {LAG_NS}: {:?}", exposures.lag_ns, seen.notes);
    assert!((exposures.mid_ns[7] - (20 * MS + 7 * 33_366_700)).abs() < MS);

    let not_looked_for = camera(true, false);
    assert_eq!(not_looked_for.tier, Tier::FreeRunning);
    assert_eq!(not_looked_for.exposures.unwrap().lag_ns, EXPOSURE_NS / 2);
}

#[test]
fn a_camera_that_does_not_see_the_lamp_stays_free_running_and_says_why() {
    let unlit = camera(false, true);
    assert_eq!(unlit.tier, Tier::FreeRunning);
    assert!(unlit.notes[0].contains("does not follow"), "{:?}", unlit.notes);
}
