//! A camera that stamps its frames itself: its clock is tied to the host's by the fastest arrivals.

use std::path::Path;

use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint},
};
use erfgs_sync::{SyncOptions, synchronise};

const START_NS: i64 = 50_000_000_000;
const MS: i64 = 1_000_000;
const FRAMES: i64 = 300;

/// The start of a frame's exposure: the rate follows the light, so that no line goes through them.
fn start_ns(index: i64) -> i64 {
    index * 20 * MS + (index * index) % 37 * 200_000
}

fn write(path: &Path, clock: StampClock) {
    let start = SessionStart { host_ns: START_NS, ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    let description = Description {
        id: "camera".into(),
        model: "simulated".into(),
        serial: String::new(),
        encoding: Encoding::Frames(PixelFormat::Grey8),
        width: 16,
        height: 16,
        start_order: 0,
        settings: serde_json::Map::new(),
    };
    let stream = writer.add_stream(&description).unwrap();
    for index in 0..FRAMES {
        let late_ns = 6 * MS + if index % 5 == 0 { 0 } else { index * 62_710_561 % 4_000_000 };
        // Fast by 50 ppm, and begun an hour before.
        let camera_ns = 3_600_000_000_000 + start_ns(index) + start_ns(index) / 20_000;
        let stamp =
            FrameStamp { kernel_ns: camera_ns, clock, point: StampPoint::StartOfExposure, sequence: index as u32 };
        let packet = Packet {
            sequence: index.cast_unsigned(),
            host_ns: START_NS + start_ns(index) + late_ns,
            discontinuity: false,
            damaged: false,
            stamp: Some(stamp),
            payload: vec![90; 256].into(),
        };
        writer.packet(stream, &packet).unwrap();
    }
    writer.finish().unwrap();
}

/// How far the times of frames lie from one constant lag behind the truth, at most, nanoseconds.
fn worst_ns(clock: StampClock) -> i64 {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    write(&path, clock);
    let mut session = Session::open(&path).unwrap();
    let sync = synchronise(&mut session, SyncOptions::default(), |_| {}).unwrap();
    let exposures = sync.stream("camera").unwrap().exposures.clone().unwrap();
    assert_eq!(exposures.mid_ns.len() as i64, FRAMES);
    let lags: Vec<i64> = (0..).zip(&exposures.mid_ns).map(|(index, mid)| mid - start_ns(index)).collect();
    let (least, most) = (lags.iter().min().unwrap(), lags.iter().max().unwrap());
    most - least
}

#[test]
fn frames_at_uneven_intervals_have_the_times_of_their_cameras_clock() {
    assert!(worst_ns(StampClock::Camera) < 5_000, "{}", worst_ns(StampClock::Camera));
    // Arrivals alone are as good as the way is even.
    assert!(worst_ns(StampClock::Unknown) > 3 * MS);
}
