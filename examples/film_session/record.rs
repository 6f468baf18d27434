//! A filmed dataset as the session that a rig with a trigger board would have recorded of it.

use std::{collections::BTreeSet, error::Error, path::Path};

use erfgs_dataset::{Camera, Dataset, Split};
use erfgs_events::EventEncoding;
use erfgs_events::{CdEvent, Edge, Evt3Encoder};
use erfgs_scene::Modality;
use erfgs_scene::pixel::PixelFormat;
use erfgs_scene::rig_file::{RigCamera, RigFile};
use erfgs_session::trigger::{code, protocol};
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint},
};

/// Host time of the session's beginning.
const START_NS: i64 = 3_000_000_000_000;
/// Session time of the dataset's zero.
pub const ZERO_NS: i64 = 1_500_000_000;
/// The board pulses for so long before the take and after it.
const AROUND_NS: i64 = 1_000_000_000;
/// A tick of the board.
const TICK_NS: f64 = 62.5;
/// Packets of an event camera hold so much time.
const PACKET_NS: i64 = 5_000_000;

/// The rig as a perfect calibration would find it.
pub fn rig(dataset: &Dataset) -> RigFile {
    let camera = |camera: &Camera| {
        RigCamera::new(&camera.name, camera.modality, camera.intrinsics, Some(camera.world_to_camera))
    };
    RigFile::new("stage", true, dataset.manifest.cameras.iter().map(camera).collect())
}

/// Writes the session: training cameras are triggered by the board, whose pulses the event cameras see; held-out cameras run
/// freely, and the kernel stamps their frames. The event cameras' clocks are 50 ppm fast and began 0.2 s before the session.
pub fn write(dataset: &Dataset, path: &Path) -> Result<(), Box<dyn Error>> {
    let start = SessionStart {
        host_ns: START_NS,
        epoch_ns: 1_750_000_000_000_000_000,
        program: "film_session".into(),
        ..SessionStart::default()
    };
    let mut writer = SessionWriter::create(path, start, "[rig]\nname = \"stage\"\n", Settings::default())?;
    let pulses = pulses(dataset);
    // Stream, arrival in session time, kernel's stamp in session time, payload.
    let mut all: Vec<(usize, i64, Option<i64>, Vec<u8>)> = Vec::new();
    let mut streams = Vec::new();
    for camera in &dataset.manifest.cameras {
        let stream = streams.len();
        if camera.modality == Modality::Event {
            streams.push(writer.add_stream(&description(
                camera,
                Encoding::Events(EventEncoding::Evt3),
                serde_json::json!({}),
            ))?);
            all.extend(event_packets(dataset, camera, &pulses)?.into_iter().map(|(t, words)| (stream, t, None, words)));
            continue;
        }
        let triggered = camera.split == Split::Train;
        let exposure_ns = camera.frames.first().map_or(0, |frame| frame.exposure_ns[1] - frame.exposure_ns[0]);
        let settings = serde_json::json!({ "triggered": triggered, "exposure_us": exposure_ns / 1000 });
        streams.push(writer.add_stream(&description(camera, Encoding::Frames(PixelFormat::Rgb8), settings))?);
        for (number, frame) in (0..).zip(&camera.frames) {
            // A triggered camera's stamp comes when the transfer begins, by up to half a millisecond late.
            let late = if triggered { 300_000 + number * 7919 % 200_000 } else { 0 };
            let stamp = ZERO_NS + frame.exposure_ns[1] + late;
            all.push((stream, stamp + 4_000_000, Some(stamp), dataset.read_image(camera, frame)?.data));
        }
    }
    let board = Description::trigger_board("board", serde_json::Map::new());
    let stream = streams.len();
    streams.push(writer.add_stream(&board)?);
    for (index, &[rise, width]) in (0_u64..).zip(&pulses) {
        let ticks = |ns: i64| (ns as f64 / TICK_NS).round() as u64;
        let line = protocol::line(&format!("p {index:x} {:x} {:x}", ticks(rise), ticks(width)));
        // Ten bits for each byte.
        let sent = line.len() as i64 * 10_000_000_000 / i64::from(protocol::BAUD);
        all.push((stream, rise + sent + (index as i64 * 31 % 7) * 40_000, None, line));
    }
    all.sort_by_key(|&(stream, arrival, ..)| (arrival, stream));
    let mut sequences = vec![0_u64; streams.len()];
    for (stream, arrival, stamp, payload) in all {
        let sequence = sequences[stream];
        sequences[stream] += 1;
        let stamp = stamp.map(|stamp| FrameStamp {
            kernel_ns: START_NS + stamp,
            clock: StampClock::Monotonic,
            point: StampPoint::EndOfFrame,
            sequence: sequence as u32,
        });
        let packet = Packet {
            sequence,
            host_ns: START_NS + arrival,
            discontinuity: false,
            damaged: false,
            stamp,
            payload: payload.into(),
        };
        writer.packet(streams[stream], &packet)?;
    }
    writer.finish()?;
    Ok(())
}

/// Rise and width of each pulse, session time: one for each exposure of the training cameras, and more before and after.
fn pulses(dataset: &Dataset) -> Vec<[i64; 2]> {
    let train = dataset.cameras(Split::Train).flat_map(|camera| &camera.frames);
    let exposures: BTreeSet<[i64; 2]> = train.map(|frame| frame.exposure_ns).collect();
    let mut pulses: Vec<[i64; 2]> = exposures.iter().map(|&[open, close]| [ZERO_NS + open, close - open]).collect();
    let (Some(&[first, width]), Some(&[second, _])) = (pulses.first(), pulses.get(1)) else { return pulses };
    let period = second - first;
    let last = pulses[pulses.len() - 1][0];
    let count = AROUND_NS / period;
    pulses.extend((1..=count).flat_map(|n| [[first - n * period, width], [last + n * period, width]]));
    pulses.sort_unstable();
    pulses
}

fn description(camera: &Camera, encoding: Encoding, settings: serde_json::Value) -> Description {
    Description {
        id: camera.name.clone(),
        model: if encoding == Encoding::Events(EventEncoding::Evt3) {
            "Prophesee EVK4".into()
        } else {
            "stage camera".into()
        },
        serial: String::new(),
        encoding,
        width: camera.intrinsics.width,
        height: camera.intrinsics.height,
        start_order: 0,
        settings: settings.as_object().cloned().unwrap_or_default(),
    }
}

/// The time of an event camera, microseconds.
fn camera_us(session_ns: i64) -> u64 {
    (200_000.0 + session_ns as f64 * 1e-3 * 1.000_05).round() as u64
}

/// When packets arrive, session time, and what is in them.
type Arrivals = Vec<(i64, Vec<u8>)>;

/// What an event camera sends.
fn event_packets(dataset: &Dataset, camera: &Camera, pulses: &[[i64; 2]]) -> Result<Arrivals, Box<dyn Error>> {
    let events = dataset.read_events(camera)?.unwrap_or_default();
    let mut edges: Vec<(i64, bool)> = (0_u64..)
        .zip(pulses)
        .flat_map(|(index, &[rise, _])| [(rise, true), (rise + code::width_ns(code::symbol(index)), false)])
        .collect();
    edges.sort_unstable();
    let mut edges = edges.into_iter().peekable();
    let mut events = events.iter().peekable();
    let mut encoder = Evt3Encoder::default();
    let mut packets = Vec::new();
    let mut end = 0;
    while edges.peek().is_some() || events.peek().is_some() {
        end += PACKET_NS;
        let mut words = Vec::new();
        loop {
            let edge = edges.peek().map_or(i64::MAX, |edge| edge.0);
            let event = events.peek().map_or(i64::MAX, |event| ZERO_NS + event.t_us * 1000);
            if edge.min(event) >= end {
                break;
            }
            if edge <= event {
                let (at, rising) = edges.next().unwrap_or_default();
                encoder.edge(Edge { t_us: camera_us(at), channel: 0, rising }, &mut words)?;
            } else if let Some(seen) = events.next() {
                encoder.event(CdEvent { t_us: camera_us(event), x: seen.x, y: seen.y, on: seen.on }, &mut words)?;
            }
        }
        encoder.finish(&mut words);
        if !words.is_empty() {
            packets.push((end + 100_000 + end / PACKET_NS * 7919 % 13 * 20_000, words));
        }
    }
    Ok(packets)
}
