//! A small session of everything that a rig has, and what is in it.

use std::path::Path;

use erfgs_events::EventEncoding;
use erfgs_events::{
    ApsFrame, CdEvent, DavisEncoder, DavisLayout, Edge, Evt2Encoder, Evt3Encoder, Evt21Encoder, ImuSample, Mark,
    WordOrder,
};
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::trigger::protocol;
use erfgs_session::{
    clock::{ClockFit, Evidence, Residuals},
    container::{SessionStart, SessionWriter, Settings, Status, StreamStatus},
    source::{Description, Encoding, FrameStamp, Incident, Packet, StampClock, StampPoint},
};

pub const START_NS: i64 = 3_000_000_000_000;
/// When the status, the incidents and the clock fit are noted.
pub const END_NS: i64 = START_NS + 10_000_000_000;
pub const EPOCH_NS: i64 = 1_750_000_000_000_000_000;
pub const RIG: &str = "# a rig\n[[event]]\nid = \"evt3\"\n";
/// Pixels of a DAVIS346.
pub const DAVIS: (u16, u16) = (346, 260);
const EVENTS: u64 = 6000;
const FRAME: [u32; 2] = [64, 48];

/// A stream of the session, and the packets that were written.
pub struct Stream {
    pub description: Description,
    pub packets: Vec<Packet>,
}

impl Stream {
    pub fn topic(&self) -> String {
        let (kind, name) = match self.description.encoding {
            Encoding::Frames(PixelFormat::Grey8) => ("frame", "grey8"),
            Encoding::Frames(PixelFormat::Yuyv) => ("frame", "yuyv"),
            Encoding::TriggerLines => ("trigger", "raw"),
            _ => ("event", "raw"),
        };
        format!("/{kind}/{}/{name}", self.description.id)
    }
}

/// What the session holds.
pub struct Recorded {
    pub streams: Vec<Stream>,
    /// Of the streams `evt3`, `evt21` and `evt2`.
    pub events: Vec<CdEvent>,
    /// Of the streams `evt3` and `evt21`.
    pub edges: Vec<Edge>,
    /// Of the stream `davis`.
    pub davis: Davis,
}

/// What a DAVIS saw.
pub struct Davis {
    pub events: Vec<CdEvent>,
    pub frames: Vec<ApsFrame>,
    pub samples: Vec<ImuSample>,
    pub marks: Vec<(u64, Mark)>,
}

/// Events from `first_us` on: single ones, and rows of neighbours at one time.
fn events(first_us: u64, (width, height): (u16, u16)) -> Vec<CdEvent> {
    let event = |n: u64| {
        let burst = n / 10;
        let (t_us, on, x) =
            if n % 10 < 7 { (0, burst.is_multiple_of(2), n % 10) } else { (n % 10 * 3, n.is_multiple_of(3), n * 31) };
        CdEvent {
            t_us: first_us + burst * 37 + t_us,
            x: ((burst * 13 + x) % u64::from(width)) as u16,
            y: (burst * 7 % u64::from(height)) as u16,
            on,
        }
    };
    (0..EVENTS).map(event).collect()
}

/// Gives each item to `encode` in order of time, edges before events.
fn merged<A: Copy, B: Copy>(items: &[(u64, A)], others: &[(u64, B)], mut encode: impl FnMut(Result<A, B>)) {
    let mut others = others.iter().peekable();
    for &(t_us, item) in items {
        while let Some(&(_, other)) = others.next_if(|other| other.0 <= t_us) {
            encode(Err(other));
        }
        encode(Ok(item));
    }
    others.for_each(|&(_, other)| encode(Err(other)));
}

fn davis() -> (Davis, Vec<u8>) {
    let (width, height) = DAVIS;
    let layout = DavisLayout::default();
    let mut encoder = DavisEncoder::new(layout);
    let mut words = Vec::new();
    // The format's edges alone: what a frame marks of itself comes with the frame.
    let (mut seen, mut marks) = (Vec::new(), Vec::new());
    let first_us = 40_000;
    for event in events(first_us, DAVIS) {
        encoder.event(event, &mut words).unwrap();
        seen.push(event);
    }
    let mut now = first_us + EVENTS / 10 * 37 + 1000;
    let (mut frames, mut samples) = (Vec::new(), Vec::new());
    for index in 0..2_u64 {
        let pixels = (0..u64::from(width) * u64::from(height)).map(|at| ((at * 7 + index * 50) % 1000) as u16);
        let [exposure_start_us, exposure_end_us] = [now, now + 9000 + index];
        let pixels = pixels.collect();
        let frame = ApsFrame { exposure_start_us, exposure_end_us, width, height, channels: 1, pixels, bits: 10 };
        encoder.frame(&frame, &mut words).unwrap();
        let of_frame = [Mark::FrameBegin, Mark::ExposureBegin, Mark::ExposureEnd, Mark::FrameEnd];
        marks.extend(
            of_frame
                .into_iter()
                .zip([exposure_start_us, exposure_start_us, exposure_end_us, exposure_end_us])
                .map(|(mark, t_us)| (t_us, mark)),
        );
        frames.push(frame);
        now = exposure_end_us + 10;
        for (step, mark) in (0..).zip([Mark::ExternalRising, Mark::ExternalFalling, Mark::ExternalPulse]) {
            encoder.mark(now + step, mark, &mut words).unwrap();
            marks.push((now + step, mark));
        }
        now += 10;
        for step in 0..3 {
            let sample = ImuSample {
                t_us: now + step * 1000,
                temperature: 36.0,
                accelerometer: [0.5, -1.0, 0.25 * step as f32],
                gyroscope: [31.25, -62.5, 500.0],
                magnetometer: [0.0; 3],
            };
            encoder.imu(sample, &mut words).unwrap();
            samples.push(sample);
        }
        now += 5000;
    }
    (Davis { events: seen, frames, samples, marks }, words)
}

/// The same events as words of EVT 3, 2.1 and 2, and the edges in the first two: not all readers take edges.
fn evt(events: &[CdEvent], edges: &[Edge]) -> [Vec<u8>; 3] {
    let [mut evt3, mut evt21, mut evt2] = [const { Vec::new() }; 3];
    let mut encoders = (Evt3Encoder::default(), Evt21Encoder::new(WordOrder::Legacy), Evt2Encoder::default());
    let events: Vec<_> = events.iter().map(|&event| (event.t_us, event)).collect();
    let edges: Vec<_> = edges.iter().map(|&edge| (edge.t_us, edge)).collect();
    merged(&events, &edges, |item| match item {
        Ok(event) => {
            encoders.0.event(event, &mut evt3).unwrap();
            encoders.1.event(event, &mut evt21).unwrap();
            encoders.2.event(event, &mut evt2).unwrap();
        }
        Err(edge) => {
            encoders.0.edge(edge, &mut evt3).unwrap();
            encoders.1.edge(edge, &mut evt21).unwrap();
        }
    });
    encoders.0.finish(&mut evt3);
    encoders.1.finish(&mut evt21);
    [evt3, evt21, evt2]
}

fn description(id: &str, model: &str, encoding: Encoding, [width, height]: [u32; 2]) -> Description {
    Description {
        id: id.into(),
        model: model.into(),
        serial: "00000042".into(),
        encoding,
        width,
        height,
        start_order: 0,
        settings: [("firmware".to_owned(), "3.9.0".into())].into_iter().collect(),
    }
}

fn packet(sequence: u64, host_ns: i64, payload: Vec<u8>) -> Packet {
    Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload: payload.into() }
}

/// A stream of bytes in packets of `length`, which cuts words in two if it is odd.
fn pieces(bytes: &[u8], length: usize) -> Vec<Packet> {
    let pieces = (0..).zip(bytes.chunks(length));
    pieces.map(|(n, piece)| packet(n, START_NS + n as i64 * 100_000_000, piece.to_vec())).collect()
}

fn frames(bytes: usize) -> Vec<Packet> {
    let frame = |n: u64| {
        let at = START_NS + n as i64 * 33_000_000;
        let stamp = FrameStamp {
            kernel_ns: at - 2_000_000,
            clock: StampClock::Monotonic,
            point: StampPoint::StartOfExposure,
            sequence: n as u32 * 2,
        };
        let pixels = (0..bytes).map(|at| (at as u64 * 3 + n) as u8).collect();
        // The second of three frames was lost.
        Packet { discontinuity: n == 2, damaged: n == 2, stamp: Some(stamp), ..packet(n + n / 2, at, pixels) }
    };
    (0..3).map(frame).collect()
}

/// Writes the session.
pub fn write(path: &Path) -> Recorded {
    // EVT 3 rolls over amid them.
    let first_us = 16_760_000;
    let seen = events(first_us, (1280, 720));
    let edge = |n: u64| Edge { t_us: first_us + n * 1111, channel: 0, rising: n.is_multiple_of(2) };
    let edges: Vec<Edge> = (0..20).map(edge).collect();
    let [evt3, evt21, evt2] = evt(&seen, &edges);
    let (davis, davis_words) = davis();
    let hd = [1280, 720];
    let lines = (0..4).map(|n| {
        let line = protocol::line(&format!("p {n:x} {:x} 13880", 500_000 + n * 533_333));
        packet(n, START_NS + n as i64 * 33_333_333, line)
    });
    let pixels = (FRAME[0] * FRAME[1]) as usize;
    let stream =
        |id, model, encoding, size, packets| Stream { description: description(id, model, encoding, size), packets };
    let streams = vec![
        stream("evt3", "Prophesee EVK4", Encoding::Events(EventEncoding::Evt3), hd, pieces(&evt3, 1001)),
        stream("evt21", "Prophesee EVK4", Encoding::Events(EventEncoding::Evt21Legacy), hd, pieces(&evt21, 1001)),
        stream("evt2", "Prophesee EVK4", Encoding::Events(EventEncoding::Evt2), hd, pieces(&evt2, 1001)),
        stream(
            "davis",
            "iniVation DAVIS346",
            Encoding::Events(EventEncoding::Davis),
            [346, 260],
            pieces(&davis_words, 9999),
        ),
        stream("grey", "Camera", Encoding::Frames(PixelFormat::Grey8), FRAME, frames(pixels)),
        stream("colour", "Camera", Encoding::Frames(PixelFormat::Yuyv), FRAME, frames(2 * pixels)),
        stream("board", "Trigger board", Encoding::TriggerLines, [0, 0], lines.collect()),
    ];
    record(path, &streams);
    Recorded { streams, events: seen, edges, davis }
}

/// Writes the packets in order of time, with a status, an incident and clock fits between.
fn record(path: &Path, streams: &[Stream]) {
    let machine = [("kernel".to_owned(), "6.1".to_owned())].into_iter().collect();
    let start = SessionStart { host_ns: START_NS, epoch_ns: EPOCH_NS, program: "erfgs test".into(), machine };
    let settings = Settings { chunk_bytes: 100_000, ..Settings::default() };
    let mut writer = SessionWriter::create(path, start, RIG, settings).unwrap();
    let ids: Vec<_> = streams.iter().map(|stream| writer.add_stream(&stream.description).unwrap()).collect();
    let mut packets: Vec<_> = streams
        .iter()
        .zip(&ids)
        .flat_map(|(stream, &id)| stream.packets.iter().map(move |packet| (id, packet)))
        .collect();
    packets.sort_by_key(|(_, packet)| packet.host_ns);
    for (stream, packet) in packets {
        writer.packet(stream, packet).unwrap();
    }
    let fit = ClockFit {
        evidence: Evidence::TriggerEdges,
        origin_ticks: 16_700_000,
        origin_ns: 1_000,
        ns_per_tick: 1000.05,
        window_ticks: [16_700_000, 16_900_000],
        residuals: Residuals { p50_ns: 300.0, p95_ns: 900.0, max_ns: 1200.5 },
        samples: 20,
        outliers: 1,
    };
    writer.clock(ids[0], END_NS, &fit).unwrap();
    for incident in [
        Incident::Lost { reason: "the cable is out".into() },
        Incident::Back,
        Incident::Warning { message: "hot".into() },
    ] {
        writer.incident(Some(ids[3]), END_NS, &incident).unwrap();
    }
    let readings = [("temperature".to_owned(), Some(41.5)), ("rate".to_owned(), None)].into_iter().collect();
    let stream = StreamStatus { readings, ..StreamStatus::default() };
    let streams = [("evt3".to_owned(), stream)].into_iter().collect();
    for disk_free_bytes in [Some(1 << 40), None] {
        let streams = std::collections::BTreeMap::clone(&streams);
        writer.status(&Status { host_ns: END_NS, written_bytes: 12, disk_free_bytes, streams }).unwrap();
    }
    writer.finish().unwrap();
}
