//! A small session to write.

use std::path::Path;

use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings, StreamId},
    source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint},
};

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

/// A writer into memory with two streams.
pub fn writer(settings: Settings) -> (SessionWriter<Vec<u8>>, StreamId, StreamId) {
    let mut writer =
        SessionWriter::new(Vec::new(), Path::new("memory.mcap"), start(), "name = \"rig\"\n", settings).unwrap();
    let events = writer.add_stream(&description("ev0", Encoding::Evt3)).unwrap();
    let frames = writer.add_stream(&description("cam0", Encoding::Mjpeg)).unwrap();
    (writer, events, frames)
}
