//! A small session to write.

use std::{collections::HashMap, io::Cursor, path::Path};

use erfgs_events::{CdEvent, EventEncoding, Evt3Encoder};
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    clock::{ClockFit, Evidence, Residuals},
    container::{Entry, Session, SessionStart, SessionWriter, Settings, Status, StreamId},
    source::{Description, Encoding, FrameStamp, Incident, Packet, StampClock, StampPoint},
};
use mcap::records::{MessageHeader, Record};

/// Host time at which the recording starts: not zero, as no host's is.
pub const START_NS: i64 = 5_000_000_000_000;

pub fn start() -> SessionStart {
    SessionStart {
        host_ns: START_NS,
        epoch_ns: 1_750_000_000_000_000_000,
        program: "erfgs test".into(),
        machine: [("kernel".to_owned(), "6.1".to_owned())].into(),
    }
}

pub fn description(id: &str, encoding: Encoding) -> Description {
    let (width, height) = if encoding == Encoding::TriggerLines { (0, 0) } else { (1280, 720) };
    Description {
        id: id.into(),
        model: "Model".into(),
        serial: "0042".into(),
        encoding,
        width,
        height,
        start_order: 0,
        settings: serde_json::from_str(r#"{"bias_fo": -12, "firmware": "3.9"}"#).unwrap(),
    }
}

/// A packet of `bytes` bytes that differ from packet to packet, one every 10 ms.
pub fn packet(sequence: u64, bytes: usize) -> Packet {
    Packet {
        sequence,
        host_ns: START_NS + sequence as i64 * 10_000_000,
        discontinuity: sequence == 3,
        damaged: sequence == 4,
        stamp: (sequence % 2 == 1).then_some(FrameStamp {
            kernel_ns: START_NS + sequence as i64 * 10_000_000 - 1_000_000,
            clock: StampClock::Monotonic,
            point: StampPoint::StartOfExposure,
            sequence: sequence as u32 * 7,
        }),
        payload: (0..bytes).map(|i| (i as u64 * 31 + sequence * 17) as u8).collect(),
    }
}

/// Forty seconds of events, in which the sensor's clock rolls over twice, in packets that cut words.
pub fn event_packets() -> impl Iterator<Item = Packet> {
    let (mut words, mut encoder, mut sequence) = (Vec::new(), Evt3Encoder::default(), 0);
    (0..200_000_u64).filter_map(move |n| {
        let event =
            CdEvent { t_us: 16_000_000 + n * 200, x: (n * 7 % 1280) as u16, y: (n / 3 % 720) as u16, on: n % 2 == 0 };
        encoder.event(event, &mut words).unwrap();
        if words.len() < 1001 {
            return None;
        }
        let packet = plain(sequence, START_NS + n as i64 * 200_000, words.drain(..1001).collect());
        sequence += 1;
        Some(packet)
    })
}

/// A packet without a stamp, of which nothing else is to be told.
pub fn plain(sequence: u64, host_ns: i64, payload: Vec<u8>) -> Packet {
    Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload: payload.into() }
}

/// A writer into memory with two streams.
pub fn writer(settings: Settings) -> (SessionWriter<Vec<u8>>, StreamId, StreamId) {
    let mut writer =
        SessionWriter::new(Vec::new(), Path::new("memory.mcap"), start(), "name = \"rig\"\n", settings).unwrap();
    let events = writer.add_stream(&description("ev0", Encoding::Events(EventEncoding::Evt3))).unwrap();
    let frames = writer.add_stream(&description("cam0", Encoding::Frames(PixelFormat::Mjpeg))).unwrap();
    (writer, events, frames)
}

/// A small session of three chunks and more with everything that a session holds, as bytes.
pub fn small_session() -> Vec<u8> {
    let (mut writer, events, frames) = writer(Settings { chunk_bytes: 1200, ..Settings::default() });
    for sequence in 0..12 {
        writer.packet(events, &packet(sequence, 200)).unwrap();
        writer.packet(frames, &packet(sequence, 50)).unwrap();
        if sequence % 4 == 2 {
            let incident = Incident::Warning { message: format!("warning {sequence}") };
            writer.incident(Some(frames), packet(sequence, 0).host_ns, &incident).unwrap();
            writer.status(&Status { host_ns: packet(sequence, 0).host_ns, ..Status::default() }).unwrap();
            writer.clock(events, packet(sequence, 0).host_ns, &fit(sequence as i64)).unwrap();
        }
    }
    writer.finish().unwrap().sink
}

pub fn fit(origin_ns: i64) -> ClockFit {
    ClockFit {
        evidence: Evidence::Arrival,
        origin_ticks: 5,
        origin_ns,
        ns_per_tick: 1000.01,
        window_ticks: [0, 9],
        residuals: Residuals { p50_ns: 1.0, p95_ns: 2.0, max_ns: 3.0 },
        samples: 3,
        outliers: 0,
    }
}

/// Reads all messages of a session; errors are left out.
pub fn entries(bytes: &[u8]) -> Vec<Entry> {
    let mut session = Session::read(Cursor::new(bytes), Path::new("memory.mcap")).unwrap();
    session.messages(None).filter_map(Result::ok).collect()
}

/// A message as the CDR of ROS 2 lays it out.
pub fn event_packet(sequence: u64, encoding: &str, events: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    let align = |bytes: &mut Vec<u8>, size: usize| {
        while !(bytes.len() - 4).is_multiple_of(size) {
            bytes.push(0);
        }
    };
    let text = |bytes: &mut Vec<u8>, text: &str| {
        while !(bytes.len() - 4).is_multiple_of(4) {
            bytes.push(0);
        }
        bytes.extend_from_slice(&(text.len() as u32 + 1).to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
        bytes.push(0);
    };
    bytes.extend_from_slice(&17_i32.to_le_bytes());
    bytes.extend_from_slice(&5_u32.to_le_bytes());
    text(&mut bytes, "optical_frame");
    align(&mut bytes, 4);
    bytes.extend_from_slice(&480_u32.to_le_bytes());
    bytes.extend_from_slice(&640_u32.to_le_bytes());
    align(&mut bytes, 8);
    bytes.extend_from_slice(&sequence.to_le_bytes());
    bytes.extend_from_slice(&123_u64.to_le_bytes());
    text(&mut bytes, encoding);
    bytes.push(0);
    align(&mut bytes, 4);
    bytes.extend_from_slice(&(events.len() as u32).to_le_bytes());
    bytes.extend_from_slice(events);
    bytes
}

/// A recording with five packets of this encoding.
pub fn ros_recording(encoding: &str) -> Vec<u8> {
    compressed_ros_recording(encoding, None)
}

/// As [`ros_recording`], of two chunks and more.
pub fn compressed_ros_recording(encoding: &str, compression: Option<mcap::Compression>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let options = mcap::WriteOptions::new().compression(compression).chunk_size(Some(300));
    let mut writer = options.create(Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema("event_camera_msgs/msg/EventPacket", "ros2msg", b"").unwrap();
    let channel = writer.add_channel(schema, "/event_camera/events", "cdr", &Default::default()).unwrap();
    for sequence in 40..45 {
        let time = 1_744_000_000_000_000_000 + sequence * 1_000_000;
        let header = MessageHeader { channel_id: channel, sequence: 0, log_time: time, publish_time: time };
        let message = event_packet(sequence, encoding, &vec![sequence as u8; sequence as usize]);
        writer.write_to_known_channel(&header, &message).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

/// The session as another program writes it that copies every record, in chunks of its own.
pub fn repacked(bytes: &[u8], compression: mcap::Compression) -> Vec<u8> {
    let mut out = Vec::new();
    let options = mcap::WriteOptions::new().compression(Some(compression)).chunk_size(Some(1200));
    let mut writer = options.create(Cursor::new(&mut out)).unwrap();
    let (mut schemas, mut channels) = (HashMap::from([(0, 0)]), HashMap::new());
    for record in mcap::read::ChunkFlattener::new(bytes).unwrap() {
        match record.unwrap() {
            Record::Schema { header, data } => {
                schemas.insert(header.id, writer.add_schema(&header.name, &header.encoding, &data).unwrap());
            }
            Record::Channel(channel) => {
                let schema = schemas[&channel.schema_id];
                let id = writer.add_channel(schema, &channel.topic, &channel.message_encoding, &channel.metadata);
                channels.insert(channel.id, id.unwrap());
            }
            Record::Message { header, data } => {
                let header = MessageHeader { channel_id: channels[&header.channel_id], ..header };
                writer.write_to_known_channel(&header, &data).unwrap();
            }
            Record::Metadata(metadata) => writer.write_metadata(&metadata).unwrap(),
            Record::Attachment { header, data, .. } => {
                let (log_time, create_time) = (header.log_time, header.create_time);
                let (name, media_type) = (header.name, header.media_type);
                writer.attach(&mcap::Attachment { log_time, create_time, name, media_type, data }).unwrap();
            }
            Record::DataEnd(_) => break,
            _ => {}
        }
    }
    writer.finish().unwrap();
    drop(writer);
    out
}
