//! Strobes of frame cameras, and pulses that trigger them, at the trigger inputs of event cameras, against the truth.

use erfgs_base::random;
use erfgs_events::{CdEvent, Edge, EventEncoding, Evt3Encoder};
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint},
    trigger::protocol::line,
};
use erfgs_sync::{StreamSync, SyncOptions, Synchronisation, Tier, synchronise};
use serde_json::json;

const START_NS: i64 = 40_000_000_000_000;
const MS: i64 = 1_000_000;
const SECONDS: i64 = 8;
const FRAMES: i64 = 400;
/// From the end of an exposure to its stamp, and how much later at most.
const LAG_NS: i64 = 3 * MS;
const JITTER_NS: i64 = 2 * MS;
/// From a pulse of the board to the exposure.
const DELAY_NS: i64 = 12_000;

/// A frame camera.
#[derive(Clone)]
struct Camera {
    id: &'static str,
    begins_ns: i64,
    exposure_ns: fn(i64) -> i64,
    settings: serde_json::Value,
    /// Frames that were exposed and did not arrive.
    lost: Vec<i64>,
}

/// An event camera whose input has the strobe of a camera.
#[derive(Clone)]
struct Eye {
    id: &'static str,
    zero_ns: i64,
    ppm: f64,
    camera: Option<Camera>,
    inverted: bool,
}

fn camera(id: &'static str) -> Camera {
    let settings = json!({ "strobe_line": "Line1", "exposure_us": 4000 });
    Camera { id, begins_ns: 700 * MS, exposure_ns: |_| 4 * MS, settings, lost: vec![40, 41, 90] }
}

fn eye(id: &'static str, camera: Option<&Camera>) -> Eye {
    Eye { id, zero_ns: -900 * MS, ppm: 60.0, camera: camera.cloned(), inverted: false }
}

impl Camera {
    fn open_ns(&self, frame: i64) -> i64 {
        self.begins_ns + frame * 16_667_123
    }

    fn span_ns(&self, frame: i64) -> [i64; 2] {
        [self.open_ns(frame), self.open_ns(frame) + (self.exposure_ns)(frame)]
    }

    fn arrived(&self) -> Vec<i64> {
        (0..FRAMES).filter(|frame| !self.lost.contains(frame)).collect()
    }

    fn packets(&self) -> Vec<Packet> {
        let packet = |(sequence, frame): (usize, i64)| {
            let late = uniform(frame as u64, 1) * JITTER_NS as f64;
            let kernel_ns = START_NS + self.span_ns(frame)[1] + LAG_NS + late as i64;
            let (clock, point) = (StampClock::Monotonic, StampPoint::EndOfFrame);
            let stamp = FrameStamp { kernel_ns, clock, point, sequence: frame as u32 };
            Packet { stamp: Some(stamp), ..packet(sequence as u64, kernel_ns - START_NS + MS, vec![90; 256]) }
        };
        self.arrived().into_iter().enumerate().map(packet).collect()
    }
}

impl Eye {
    fn t_us(&self, at_ns: i64) -> u64 {
        ((at_ns - self.zero_ns) as f64 * 1e-3 * (1.0 + self.ppm * 1e-6)).floor() as u64
    }

    /// A packet a millisecond with two events and the edges.
    fn packets(&self) -> Vec<Packet> {
        let mut encoder = Evt3Encoder::default();
        let spans = self.camera.iter().flat_map(|camera| (0..FRAMES).map(|frame| camera.span_ns(frame)));
        let mut edges = spans.flat_map(|[open, close]| [(open, true), (close, false)]).peekable();
        let mut arrived = 0;
        let packet = |ms: i64| {
            let mut payload = Vec::new();
            for at_ns in [ms * MS + 100, ms * MS + MS / 2] {
                while let Some((at_ns, rising)) = edges.next_if(|edge| edge.0 <= at_ns) {
                    let edge = Edge { t_us: self.t_us(at_ns), channel: 0, rising: rising != self.inverted };
                    encoder.edge(edge, &mut payload).unwrap();
                }
                let t_us = self.t_us(at_ns);
                encoder.event(CdEvent { t_us, x: (t_us % 16) as u16, y: 3, on: true }, &mut payload).unwrap();
            }
            encoder.finish(&mut payload);
            let late = 100_000.0 - 150_000.0 * uniform(ms as u64, 2).ln();
            arrived = arrived.max((ms + 1) * MS + late as i64);
            packet(ms as u64, arrived, payload)
        };
        (0..SECONDS * 1000).map(packet).collect()
    }
}

fn uniform(n: u64, purpose: u64) -> f64 {
    random::range(random::key(5, &[n, purpose]), 1e-9, 1.0)
}

fn packet(sequence: u64, session_ns: i64, payload: Vec<u8>) -> Packet {
    let host_ns = START_NS + session_ns;
    Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload: payload.into() }
}

fn description(id: &str, encoding: Encoding, settings: &serde_json::Value) -> Description {
    let side = if encoding == Encoding::TriggerLines { 0 } else { 16 };
    Description {
        id: id.into(),
        model: "simulated".into(),
        serial: String::new(),
        encoding,
        width: side,
        height: side,
        start_order: 0,
        settings: settings.as_object().unwrap().clone(),
    }
}

/// Pulses of a board, at which the camera exposes.
fn board(camera: &Camera) -> Vec<Packet> {
    let ticks = |ns: i64| (ns as f64 / 62.5).round() as u64;
    let pulse = |index: i64| {
        let rise = camera.open_ns(index) - DELAY_NS;
        let bytes = line(&format!("p {index:x} {:x} {:x}", ticks(rise), ticks(4 * MS)));
        packet(index as u64, rise + bytes.len() as i64 * 20_000 + 60_000, bytes)
    };
    (0..FRAMES).map(pulse).collect()
}

/// What synchronisation finds in such a session.
fn found(cameras: &[&Camera], eyes: &[Eye], board: Option<Vec<Packet>>) -> Synchronisation {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    let start = SessionStart { host_ns: START_NS, ..SessionStart::default() };
    let mut writer = SessionWriter::create(&path, start, "", Settings::default()).unwrap();
    let grey = Encoding::Frames(PixelFormat::Grey8);
    let events = Encoding::Events(EventEncoding::Evt3);
    let mut streams: Vec<(Description, Vec<Packet>)> = Vec::new();
    streams.extend(cameras.iter().map(|camera| (description(camera.id, grey, &camera.settings), camera.packets())));
    streams.extend(eyes.iter().map(|eye| (description(eye.id, events, &json!({})), eye.packets())));
    streams.extend(board.map(|lines| (description("board", Encoding::TriggerLines, &json!({})), lines)));
    let mut packets = Vec::new();
    for (description, of_stream) in streams {
        let stream = writer.add_stream(&description).unwrap();
        packets.extend(of_stream.into_iter().map(|packet| (stream, packet)));
    }
    packets.sort_by_key(|(_, packet)| packet.host_ns);
    packets.iter().for_each(|(stream, packet)| writer.packet(*stream, packet).unwrap());
    writer.finish().unwrap();
    synchronise(&mut Session::open(&path).unwrap(), SyncOptions::default(), |_| {}).unwrap()
}

/// By how much the middles of exposures are late, at least and at most; each has its own frame and length.
fn late(sync: &StreamSync, camera: &Camera) -> [i64; 2] {
    let exposures = sync.exposures.as_ref().unwrap();
    let arrived = camera.arrived();
    assert_eq!(exposures.sequence, (0..arrived.len() as u64).collect::<Vec<_>>());
    for (&frame, &length) in arrived.iter().zip(&exposures.exposure_ns) {
        assert!((length - (camera.exposure_ns)(frame)).abs() <= 1000, "frame {frame}: {length}");
    }
    let late = arrived.iter().zip(&exposures.mid_ns).map(|(&frame, mid_ns)| {
        let [open, close] = camera.span_ns(frame);
        mid_ns - (open + close) / 2
    });
    let late: Vec<i64> = late.collect();
    [*late.iter().min().unwrap(), *late.iter().max().unwrap()]
}

/// Frames dated on the clock of an eye: late as that is by arrivals, and all alike.
fn check(sync: &Synchronisation, camera: &Camera) {
    let of = sync.stream(camera.id).unwrap();
    assert_eq!((of.tier, &of.faults[..]), (Tier::Strobe, &["3 pulses that eye saw gave no frame".to_owned()][..]));
    let [least, most] = late(of, camera);
    assert!(least > 0 && most < 2 * MS && most - least < 3000, "{least} to {most}");
}

#[test]
fn a_free_running_camera_is_dated_by_the_event_camera_that_sees_its_strobe() {
    let camera = camera("rgb");
    let sync = found(&[&camera], &[eye("blind", None), eye("eye", Some(&camera))], None);
    check(&sync, &camera);
    let seeing = sync.stream("eye").unwrap();
    assert!(seeing.tier == Tier::Strobe && seeing.notes[0].contains("strobe of 'rgb'"), "{:?}", seeing.notes);
    assert_eq!(sync.stream("blind").unwrap().tier, Tier::FreeRunning);
}

#[test]
fn each_exposure_is_as_long_as_its_own_strobe_where_no_exposure_is_set() {
    let settings = json!({ "strobe_line": "Line1" });
    let camera = Camera { settings, exposure_ns: |frame| (1 + frame % 7) * 2 * MS, ..camera("rgb") };
    check(&found(&[&camera], &[eye("eye", Some(&camera))], None), &camera);
}

#[test]
fn a_strobe_that_is_low_while_the_sensor_is_exposed_is_told_by_its_length() {
    let camera = camera("rgb");
    let sync = found(&[&camera], &[Eye { inverted: true, ..eye("eye", Some(&camera)) }], None);
    check(&sync, &camera);
    let notes = &sync.stream("rgb").unwrap().notes;
    assert!(notes.iter().any(|note| note.contains("is low while")), "{notes:?}");
}

#[test]
fn event_cameras_that_see_one_strobe_share_one_clock_to_microseconds() {
    let camera = camera("rgb");
    let other = Eye { zero_ns: 300_123_456 - 900 * MS, ppm: -45.0, ..eye("other", Some(&camera)) };
    let eyes = [eye("eye", Some(&camera)), other];
    let sync = found(&[&camera], &eyes, None);
    check(&sync, &camera);
    for frame in 0..FRAMES {
        let at_ns = camera.open_ns(frame) + 5 * MS;
        let [a, b] = eyes.each_ref().map(|eye| {
            let clock = sync.stream(eye.id).unwrap().epochs.clocks().next().unwrap().clone();
            clock.session_ns(eye.t_us(at_ns).cast_signed())
        });
        assert!((a - b).abs() < 3000, "frame {frame}: {}", a - b);
    }
}

#[test]
fn a_strobe_of_a_camera_that_the_board_triggers_ties_the_event_camera_to_the_board() {
    let settings = json!({ "strobe_line": "Line1", "exposure_us": 4000, "triggered": true });
    let camera = Camera { settings, ..camera("rgb") };
    let eye = eye("eye", Some(&camera));
    let sync = found(&[&camera], std::slice::from_ref(&eye), Some(board(&camera)));
    // The board's clock is late by what its line takes, and the exposure by the camera's delay, which is taken for nothing.
    let [least, most] = late(sync.stream("rgb").unwrap(), &camera);
    let line_ns = 60_000;
    assert!((least + DELAY_NS - line_ns).abs() < 3000 && (most + DELAY_NS - line_ns).abs() < 3000, "{least} to {most}");
    let seeing = sync.stream("eye").unwrap();
    let clock = seeing.epochs.clocks().next().unwrap();
    assert!(clock.residuals.p95_ns < 2000.0 && clock.outliers == 0, "{clock:?}");
    assert_eq!((seeing.tier, &seeing.faults[..]), (Tier::Strobe, &[][..]));
}

#[test]
fn strobes_that_nothing_tells_apart_are_not_guessed_and_the_rig_can_tell_them() {
    let of = |id, begins_ns, to: &str| {
        let strobe_to = if to.is_empty() { vec![] } else { vec![to] };
        let settings = json!({ "strobe_line": "Line1", "strobe_to": strobe_to, "exposure_us": 4000 });
        Camera { begins_ns, settings, ..camera(id) }
    };
    let with = |to: [&str; 2]| {
        let [a, b] = [of("a", 700 * MS, to[0]), of("b", 705 * MS, to[1])];
        let eyes = [eye("eye", Some(&a)), eye("other", Some(&b))];
        (found(&[&a, &b], &eyes, None), a)
    };
    let (sync, _) = with(["", ""]);
    for id in ["a", "b"] {
        let of = sync.stream(id).unwrap();
        assert!(of.tier == Tier::FreeRunning && of.faults[0].contains("say with strobe_to"), "{:?}", of.faults);
    }
    // What one of them says is enough for both.
    for to in [["eye", "other"], ["eye", ""]] {
        let (sync, a) = with(to);
        check(&sync, &a);
        assert_eq!(sync.stream("b").unwrap().tier, Tier::Strobe, "{:?}", sync.stream("b").unwrap().faults);
    }
    let (sync, _) = with(["rgb", ""]);
    let faults = &sync.stream("a").unwrap().faults;
    assert!(faults[0].contains("'rgb', which is no event camera"), "{faults:?}");
}

#[test]
fn edges_that_are_no_strobe_of_the_camera_date_nothing() {
    let camera = camera("rgb");
    let settings = json!({ "exposure_us": 4000 });
    let slow = Camera { begins_ns: 700 * MS, exposure_ns: |frame| 4 * MS + frame % 3, settings, ..camera.clone() };
    // Of another exposure; of another rate, as long; none.
    let longer = Camera { exposure_ns: |_| 6 * MS, ..slow.clone() };
    for seen in [Some(&longer), None] {
        let sync = found(&[&camera], &[eye("eye", seen)], None);
        let of = sync.stream("rgb").unwrap();
        assert!(
            of.tier == Tier::FreeRunning && of.faults[0].contains("check the wire of its strobe"),
            "{:?}",
            of.faults
        );
        assert!(of.exposures.is_some());
    }
    // A camera without a strobe is dated as ever.
    let sync = found(&[&slow], &[eye("eye", Some(&slow))], None);
    let of = sync.stream("rgb").unwrap();
    assert_eq!((of.tier, &of.faults[..]), (Tier::FreeRunning, &[][..]));
}

/// Pulses of a generator that go to two cameras and two event cameras: an eye sees them as a camera that is exposed so long.
fn generated(high_ns: fn(i64) -> i64) -> Camera {
    Camera { id: "generator", exposure_ns: high_ns, settings: json!({}), lost: Vec::new(), begins_ns: 700 * MS }
}

#[test]
fn pulses_of_a_generator_begin_the_exposures_of_all_cameras_that_they_trigger() {
    let pulses = generated(|_| MS);
    let of = |id, exposure_ns: fn(i64) -> i64, lost: &[i64]| {
        let settings = json!({ "triggered": true, "exposure_us": exposure_ns(0) / 1000 });
        Camera { exposure_ns, settings, lost: lost.to_vec(), ..camera(id) }
    };
    let cameras = [of("short", |_| 2 * MS, &[1, 9, 55]), of("long", |_| 9 * MS, &[3, 4, 200])];
    let other = Eye { zero_ns: 411_000_789 - 900 * MS, ppm: 20.0, ..eye("other", Some(&pulses)) };
    let eyes = [eye("eye", Some(&pulses)), other];
    let sync = found(&cameras.each_ref(), &eyes, None);
    let mut lates = Vec::new();
    for camera in &cameras {
        let of = sync.stream(camera.id).unwrap();
        assert_eq!((of.tier, of.faults.len()), (Tier::HardwareTriggered, 1), "{:?}", of.faults);
        lates.extend(late(of, camera));
    }
    let [least, most] = [*lates.iter().min().unwrap(), *lates.iter().max().unwrap()];
    assert!(least > 0 && most < 2 * MS && most - least < 4000, "{lates:?}");
    let at_ns = 3_333 * MS;
    let [a, b] = eyes.each_ref().map(|eye| {
        let found = sync.stream(eye.id).unwrap();
        assert_eq!(found.tier, Tier::HardwareTriggered);
        found.epochs.clocks().next().unwrap().session_ns(eye.t_us(at_ns).cast_signed())
    });
    assert!((a - b).abs() < 3000, "{}", a - b);
}

#[test]
fn a_camera_that_begins_with_falling_edges_or_exposes_while_its_trigger_is_high() {
    // High for 5 ms; it begins with the fall and exposes for 4 ms.
    let pulses = generated(|_| 5 * MS);
    let settings = json!({ "triggered": true, "exposure_us": 4000, "genicam": { "TriggerActivation": "FallingEdge" } });
    let falling = Camera { begins_ns: 705 * MS, settings, ..camera("rgb") };
    // As long as its pulse.
    let level = Camera { exposure_ns: |_| 5 * MS, settings: json!({ "triggered": true }), ..camera("rgb") };
    for camera in [falling, level] {
        let sync = found(&[&camera], &[eye("eye", Some(&pulses))], None);
        let of = sync.stream("rgb").unwrap();
        assert_eq!(of.tier, Tier::HardwareTriggered, "{:?}", of.notes);
        let [least, most] = late(of, &camera);
        assert!(least > 0 && most < 2 * MS && most - least < 3000, "{least} to {most}");
    }
    // Pulses of different lengths are not how long it exposes.
    let coded = generated(|pulse| MS * (1 + pulse % 3));
    let camera = Camera { settings: json!({ "triggered": true }), ..camera("rgb") };
    let sync = found(&[&camera], &[eye("eye", Some(&coded))], None);
    assert_eq!(sync.stream("rgb").unwrap().tier, Tier::FreeRunning);
}
