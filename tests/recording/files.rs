//! A small session with everything in it, made from the protocols alone.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use erfgs_events::EventEncoding;
use erfgs_events::{CdEvent, Edge, Evt3Encoder};
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::trigger::{code, protocol};
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint},
};

pub const START_NS: i64 = 3_000_000_000_000;
/// Pulses of the board: 30 Hz, the first after half a second.
pub const PULSES: u64 = 60;
pub const PERIOD_NS: i64 = 33_333_250;
pub const EXPOSURE_NS: i64 = 5_000_000;
pub const FIRST_NS: i64 = 500_000_000;

/// Runs the program in `folder`.
pub fn erfgs(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_erfgs")).current_dir(folder).args(arguments).output().expect("erfgs starts")
}

/// Runs the program, which must succeed, and gives its stdout as JSON.
pub fn json(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    let output = erfgs(folder, arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {stderr}");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{arguments:?}: {error}"))
}

/// A stream of this name.
pub fn description(id: &str, encoding: Encoding, size: [u32; 2], settings: serde_json::Value) -> Description {
    Description {
        id: id.into(),
        model: if encoding == Encoding::Events(EventEncoding::Evt3) { "Prophesee EVK4".into() } else { "Model".into() },
        serial: "00050423".into(),
        encoding,
        width: size[0],
        height: size[1],
        start_order: 0,
        settings: settings.as_object().cloned().unwrap_or_default(),
    }
}

/// Session time of a pulse.
pub fn pulse_ns(index: u64) -> i64 {
    FIRST_NS + index as i64 * PERIOD_NS
}

/// The events of the camera, whose clock started 0.2 s before the session and is 50 ppm fast: 20 for each millisecond,
/// and the edges of the board's pulses.
pub fn camera_us(session_ns: i64) -> u64 {
    (200_000.0 + session_ns as f64 * 1e-3 * 1.000_05) as u64
}

/// Writes the session `s.mcap` into `folder`; gives its path and the events of its camera.
pub fn write_session(folder: &Path) -> (PathBuf, Vec<CdEvent>) {
    let path = folder.join("s.mcap");
    let start = SessionStart {
        host_ns: START_NS,
        epoch_ns: 1_750_000_000_000_000_000,
        program: "erfgs test".into(),
        ..SessionStart::default()
    };
    let settings = Settings { chunk_bytes: 20_000, ..Settings::default() };
    let mut writer = SessionWriter::create(&path, start, "[rig]\n", settings).unwrap();
    let camera = description(
        "ev0",
        Encoding::Events(EventEncoding::Evt3),
        [1280, 720],
        serde_json::json!({"firmware": "3.9.0"}),
    );
    let camera = writer.add_stream(&camera).unwrap();
    let triggered = serde_json::json!({"triggered": true, "exposure_us": 5000});
    let frames =
        writer.add_stream(&description("cam0", Encoding::Frames(PixelFormat::Grey8), [64, 48], triggered)).unwrap();
    let board = description("mcu", Encoding::TriggerLines, [0, 0], serde_json::json!({}));
    let board = writer.add_stream(&board).unwrap();
    let mut events = Vec::new();
    let mut encoder = Evt3Encoder::default();
    // Edges in order of time: rises and falls of the event cameras' line.
    let mut edges: Vec<(i64, bool)> = (0..PULSES)
        .flat_map(|index| {
            let rise = pulse_ns(index);
            [(rise, true), (rise + code::width_ns(code::symbol(index)), false)]
        })
        .collect();
    edges.sort_unstable();
    let mut edges = edges.into_iter().peekable();
    let mut next_pulse = 0;
    let [mut sequence, mut frame, mut line] = [0; 3];
    let host = |sequence: &mut u64, session_ns: i64, payload: Vec<u8>, stamp| {
        let packet = Packet {
            sequence: *sequence,
            host_ns: START_NS + session_ns,
            discontinuity: false,
            damaged: false,
            stamp,
            payload: payload.into(),
        };
        *sequence += 1;
        packet
    };
    for ms in 0..2600_i64 {
        let mut words = Vec::new();
        let now = ms * 1_000_000;
        for n in 0..20 {
            let at = now + n * 50_000;
            while let Some((edge_ns, rising)) = edges.next_if(|edge| edge.0 <= at) {
                encoder.edge(Edge { t_us: camera_us(edge_ns), channel: 0, rising }, &mut words).unwrap();
            }
            let event = CdEvent {
                t_us: camera_us(at),
                x: ((ms * 20 + n) * 7 % 1280) as u16,
                y: ((ms * 20 + n) * 3 % 720) as u16,
                on: n % 3 == 0,
            };
            encoder.event(event, &mut words).unwrap();
            events.push(event);
        }
        encoder.finish(&mut words);
        let late = 100_000 + (ms * 7919 % 13) * 20_000;
        writer.packet(camera, &host(&mut sequence, now + 1_000_000 + late, words, None)).unwrap();
        while next_pulse < PULSES && pulse_ns(next_pulse) + EXPOSURE_NS < now {
            let rise = pulse_ns(next_pulse);
            let tick = (rise as f64 / 62.5).round() as u64;
            let text = protocol::line(&format!("p {next_pulse:x} {tick:x} 13880"));
            let arrival = rise + 600_000 + (next_pulse as i64 * 31 % 7) * 40_000;
            writer.packet(board, &host(&mut line, arrival, text, None)).unwrap();
            let stamp = FrameStamp {
                kernel_ns: START_NS + rise + EXPOSURE_NS + 400_000 + (next_pulse as i64 * 17 % 5) * 90_000,
                clock: StampClock::Monotonic,
                point: StampPoint::StartOfExposure,
                sequence: next_pulse as u32,
            };
            let picture = (0..64 * 48).map(|at| (at as u64 % 64 * 3 + next_pulse) as u8).collect();
            writer.packet(frames, &host(&mut frame, rise + EXPOSURE_NS + 9_000_000, picture, Some(stamp))).unwrap();
            next_pulse += 1;
        }
    }
    writer.finish().unwrap();
    (path, events)
}
