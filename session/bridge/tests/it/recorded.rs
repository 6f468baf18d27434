//! A session without a trigger board, of cameras of all kinds, and its rig file.

use std::path::Path;

use erfgs_events::{ApsFrame, CdEvent, DavisEncoder, DavisLayout, Edge, EventEncoding, Evt2Encoder, Evt3Encoder};
use erfgs_scene::{
    Distortion, Intrinsics, Modality, Pose, image,
    pixel::{BayerOrder, PixelFormat, Samples},
    rig_file::{RigCamera, RigFile},
};
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, Packet},
};

pub const START_NS: i64 = 7_000_000_000_000;
pub const EPOCH_NS: i64 = 1_750_000_000_123_456_789;
pub const FRAMES: u64 = 24;
const MS: i64 = 1_000_000;
/// Columns and rows of the frame cameras.
pub const SIZE: [u32; 2] = [32, 16];
pub const EVENTS: [u16; 2] = [64, 40];

/// The cameras' frames, each as it came.
pub const CAMERAS: [(&str, PixelFormat); 6] = [
    ("jpeg", PixelFormat::Mjpeg),
    ("grey-12", PixelFormat::Grey12Packed),
    ("bayer", PixelFormat::Bayer(BayerOrder::Grbg, Samples::Bits8)),
    ("0deep", PixelFormat::Bayer(BayerOrder::Rggb, Samples::Lsb10)),
    ("yuyv", PixelFormat::Yuyv),
    ("nv12", PixelFormat::Nv12),
];

/// What an event camera saw: its clock began 16.5 s before the session, so that EVT 3 rolls over within it.
pub const DEVICE_US: u64 = 16_500_000;

/// The events of 800 ms: three a millisecond, none between 300 and 500 ms.
pub fn events() -> Vec<CdEvent> {
    let event = |n: u64| CdEvent {
        t_us: DEVICE_US + n / 3 * 1000 + n % 3 * 200,
        x: (n * 7 % u64::from(EVENTS[0])) as u16,
        y: (n / 5 % u64::from(EVENTS[1])) as u16,
        on: n.is_multiple_of(2),
    };
    (0..2400).filter(|n| !(900..1500).contains(n)).map(event).collect()
}

/// Edges at the trigger input, every 100 ms.
pub fn edges() -> Vec<Edge> {
    (0..8).map(|n| Edge { t_us: DEVICE_US + n * 100_000 + 50, channel: 0, rising: n % 2 == 0 }).collect()
}

fn packet(sequence: u64, session_ns: i64, payload: Vec<u8>) -> Packet {
    let host_ns = START_NS + session_ns;
    Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload: payload.into() }
}

/// A packet every 10 ms that arrives at its end; the words go on from packet to packet.
fn packets(mut encode: impl FnMut(&[CdEvent], &[Edge], &mut Vec<u8>)) -> Vec<Packet> {
    let (events, edges) = (events(), edges());
    let within = |t_us: u64, part: u64| (t_us - DEVICE_US) / 10_000 == part;
    let one = |part: u64| {
        let mut words = Vec::new();
        let of_part: Vec<_> = events.iter().filter(|event| within(event.t_us, part)).copied().collect();
        let edges: Vec<_> = edges.iter().filter(|edge| within(edge.t_us, part)).copied().collect();
        encode(&of_part, &edges, &mut words);
        packet(part, (part as i64 + 1) * 10 * MS, words)
    };
    (0..80).map(one).collect()
}

fn evt3() -> Vec<Packet> {
    let mut encoder = Evt3Encoder::default();
    packets(move |events, edges, words| {
        let mut edges = edges.iter().copied().peekable();
        for &event in events {
            while let Some(edge) = edges.next_if(|edge| edge.t_us <= event.t_us) {
                encoder.edge(edge, words).unwrap();
            }
            encoder.event(event, words).unwrap();
        }
        edges.for_each(|edge| encoder.edge(edge, words).unwrap());
        encoder.finish(words);
    })
}

fn evt2() -> Vec<Packet> {
    let mut encoder = Evt2Encoder::default();
    packets(move |events, _, words| events.iter().for_each(|&event| encoder.event(event, words).unwrap()))
}

/// Frames of the sensor's own pixels, of which the DAVIS sends one every 100 ms.
pub fn davis_frames() -> Vec<ApsFrame> {
    let frame = |n: u64| ApsFrame {
        exposure_start_us: DEVICE_US + (n + 1) * 100_000 - 300,
        exposure_end_us: DEVICE_US + (n + 1) * 100_000 + 4_000 + n,
        width: 346,
        height: 260,
        channels: 1,
        pixels: (0..346 * 260).map(|at| ((at * 5 + n * 40) % 1000) as u16).collect(),
        bits: 10,
    };
    (0..3).map(frame).collect()
}

fn davis() -> Vec<Packet> {
    let mut encoder = DavisEncoder::new(DavisLayout::default());
    let mut frames = davis_frames().into_iter().peekable();
    packets(move |events, _, words| {
        // The frame first: its words are older than the events behind it.
        let first = events.first().map(|event| event.t_us);
        if let Some(frame) = frames.next_if(|frame| first.is_some_and(|t_us| frame.exposure_start_us < t_us)) {
            encoder.frame(&frame, words).unwrap();
            let events = events.iter().filter(|event| event.t_us > frame.exposure_end_us);
            events.for_each(|&event| encoder.event(event, words).unwrap());
            return;
        }
        events.iter().for_each(|&event| encoder.event(event, words).unwrap());
    })
}

/// A frame of a camera: number 5 is cut.
fn frame(pixels: PixelFormat, n: u64) -> Vec<u8> {
    let [width, height] = SIZE;
    let level = |at: u64| (at * 3 + n * 9) % 200;
    let mut bytes = match (pixels, pixels.samples()) {
        (PixelFormat::Mjpeg, _) => {
            let rgb: Vec<u8> = (0..u64::from(width * height) * 3).map(|at| (level(at / 96) + at % 3) as u8).collect();
            bare(&image::jpeg(&rgb, width, height, 90).unwrap())
        }
        (_, Some(samples)) => {
            let white = u64::from(samples.white());
            let values: Vec<u16> = (0..u64::from(width * height)).map(|at| (level(at) * white / 200) as u16).collect();
            samples.pack(&values)
        }
        _ => {
            let bytes = erfgs_scene::pixel::frame_bytes(pixels, width, height).unwrap() as u64;
            (0..bytes).map(|at| (16 + level(at)) as u8).collect()
        }
    };
    if n == 5 {
        bytes.truncate(bytes.len() / 3);
    }
    bytes
}

/// Without its Huffman tables, as many cameras send it.
fn bare(jpeg: &[u8]) -> Vec<u8> {
    let (mut at, mut out) = (2, jpeg[..2].to_vec());
    loop {
        let end = at + 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]]));
        match jpeg[at + 1] {
            0xc4 => {}
            0xda => break,
            _ => out.extend(&jpeg[at..end]),
        }
        at = end;
    }
    out.extend(&jpeg[at..]);
    out
}

fn description(id: &str, encoding: Encoding, [width, height]: [u32; 2]) -> Description {
    let (model, serial, settings) = ("simulated".into(), String::new(), serde_json::Map::new());
    Description { id: id.into(), model, serial, encoding, width, height, start_order: 0, settings }
}

/// Writes the session; gives what came of each stream.
pub fn write(path: &Path) -> Vec<(String, Vec<Packet>)> {
    let of_events = EVENTS.map(u32::from);
    let mut streams = vec![
        (description("ev3", EventEncoding::Evt3.into(), of_events), evt3()),
        (description("ev2", EventEncoding::Evt2.into(), of_events), evt2()),
        (description("davis", EventEncoding::Davis.into(), [346, 260]), davis()),
        (description("dead", PixelFormat::Rgb8.into(), SIZE), Vec::new()),
        (description("silent", EventEncoding::Evt3.into(), of_events), Vec::new()),
        (description("board", Encoding::TriggerLines, [0, 0]), Vec::new()),
    ];
    for (at, (id, pixels)) in CAMERAS.into_iter().enumerate() {
        let one = |n: u64| packet(n, 15 * MS + n as i64 * 33 * MS + at as i64 * MS, frame(pixels, n));
        streams.push((description(id, pixels.into(), SIZE), (0..FRAMES).map(one).collect()));
    }
    let start = SessionStart { host_ns: START_NS, epoch_ns: EPOCH_NS, ..SessionStart::default() };
    let settings = Settings { chunk_bytes: 20_000, ..Settings::default() };
    let mut writer = SessionWriter::create(path, start, "", settings).unwrap();
    let ids: Vec<_> = streams.iter().map(|(stream, _)| writer.add_stream(stream).unwrap()).collect();
    let mut all: Vec<_> = streams
        .iter()
        .zip(&ids)
        .flat_map(|((_, packets), &id)| packets.iter().map(move |packet| (id, packet)))
        .collect();
    all.sort_by_key(|(_, packet)| packet.host_ns);
    all.iter().for_each(|(id, packet)| writer.packet(*id, packet).unwrap());
    writer.finish().unwrap();
    streams.into_iter().map(|(stream, packets)| (stream.id, packets)).collect()
}

/// Lenses of every model, one camera without a pose, one with an offset of its clock, and one that did not record.
pub fn rig() -> RigFile {
    let lens = |[width, height]: [u32; 2], distortion| {
        let (fx, fy, cx, cy) = (50.5, 51.25, f64::from(width) / 2.0 + 0.25, f64::from(height) / 2.0 - 1.0);
        Intrinsics { width, height, fx, fy, cx, cy, distortion }
    };
    let down = glam::DVec3::Y;
    let pose = |x: f64| Pose::look_at(glam::DVec3::new(x, -0.5, -2.0), glam::DVec3::new(0.1, 0.2, 0.3), down);
    let brown = [-0.1, 0.02, 1e-3, -2e-3, 0.005, 0.0, 0.0, 0.0];
    let rational = [-0.1, 0.02, 1e-3, -2e-3, 0.005, 0.01, 0.002, 0.003];
    let camera = |id: &str, modality, intrinsics, x: Option<f64>| RigCamera::new(id, modality, intrinsics, x.map(pose));
    let mut late = camera("grey-12", Modality::Rgb, lens(SIZE, Distortion::BrownConrady(rational)), Some(1.0));
    late.time_offset_s = -0.0025;
    let fisheye = Distortion::KannalaBrandt([0.01, -0.02, 0.003, 0.0]);
    RigFile::new(
        "board",
        true,
        vec![
            camera("jpeg", Modality::Rgb, lens(SIZE, Distortion::BrownConrady(brown)), Some(0.0)),
            late,
            camera("ev3", Modality::Event, lens(EVENTS.map(u32::from), fisheye), Some(-1.0)),
            camera("davis", Modality::Both, lens([346, 260], Distortion::None), None),
            camera("elsewhere", Modality::Rgb, lens([640, 480], Distortion::None), Some(2.0)),
        ],
    )
}
