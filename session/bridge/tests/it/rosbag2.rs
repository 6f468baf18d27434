//! A bag of ROS 2, read by rosbags with its own definitions of the standard messages, and by our own importer.

use std::path::Path;

use erfgs_bridge::{
    BridgeError,
    rosbag2::{self, Rosbag2Choice},
};
use erfgs_events::{Columns, EventFileHints};
use erfgs_scene::{
    pixel::{self, PixelFormat},
    rig_file::RigFile,
};
use erfgs_session::{Recording, source::Packet};
use erfgs_sync::reading::{ALWAYS_NS, EventClock, FrameLook, TimedRecording};
use serde_json::{Value, json};

use crate::{
    oracle::{self, Found, list, numbers},
    recorded::{self, CAMERAS, EPOCH_NS, FRAMES, SIZE, START_NS},
};

fn open(path: &Path) -> TimedRecording {
    TimedRecording::open(path, &EventFileHints::default()).unwrap()
}

fn log_ns(packet: &Packet) -> Value {
    json!(EPOCH_NS + packet.host_ns - START_NS)
}

/// The events and edges of a stream of a recording.
fn events(path: &Path, id: &str) -> Columns {
    let mut recording = Recording::open(path, None).unwrap();
    let (stream, _) = recording.stream(id).unwrap();
    let mut columns = Columns::default();
    let decoded = recording.decode_events(stream, &mut columns, |_| {}).unwrap().unwrap();
    assert!(decoded.anomalies.is_empty() && decoded.damage.is_empty(), "{id}: {decoded:?}");
    columns
}

fn assert_events(found: &Columns, expected: &Columns, id: &str) {
    assert!(found.t_us == expected.t_us, "{id}: times");
    assert!((&found.x, &found.y, &found.on) == (&expected.x, &expected.y, &expected.on), "{id}");
    assert_eq!(found.edges, expected.edges, "{id}");
}

/// ROS's name, the step and the bytes that a frame has in the bag.
fn expected_image(pixels: PixelFormat, payload: &[u8]) -> (&'static str, u32, Vec<u8>) {
    let [width, height] = SIZE;
    let shifted = |bits: u32| -> Vec<u8> {
        let values = pixels.samples().unwrap().unpack(payload);
        values.into_iter().flat_map(|value| (value << bits).to_le_bytes()).collect()
    };
    match pixels {
        PixelFormat::Grey12Packed => ("mono16", 2 * width, shifted(4)),
        PixelFormat::Yuyv => ("yuv422_yuy2", 2 * width, payload.to_vec()),
        PixelFormat::Nv12 => ("rgb8", 3 * width, pixel::decode(pixels, width, height, payload).unwrap().data),
        PixelFormat::Bayer(_, samples) if samples.bits() == 10 => ("bayer_rggb16", 2 * width, shifted(6)),
        _ => ("bayer_grbg8", width, payload.to_vec()),
    }
}

#[test]
fn others_read_every_message_and_our_importer_every_event() {
    let folder = tempfile::tempdir().unwrap();
    let (session, bag) = (folder.path().join("s.mcap"), folder.path().join("deep/bag"));
    let streams = recorded::write(&session);
    let packets = |id: &str| &streams.iter().find(|(stream, _)| stream == id).unwrap().1;
    let rig = recorded::rig();
    let mut recording = open(&session);
    let choice = Rosbag2Choice { rig: Some(&rig), ..Rosbag2Choice::default() };
    let written = rosbag2::write(&mut recording, &choice, &bag, |_, _| {}).unwrap();
    let found = oracle::read("rosbag2", &bag);
    let messages = &found.all["messages"];
    for topic in &written.topics {
        let durability = if topic.topic == "/tf_static" { json!(["TRANSIENT_LOCAL"]) } else { json!([]) };
        let expected = json!([topic.schema, topic.messages, durability]);
        assert_eq!(found.all["topics"][&topic.topic], expected, "{}", topic.topic);
        assert_eq!(list(&messages[&topic.topic]).len() as u64, topic.messages);
    }
    assert_eq!(found.all["topics"].as_object().unwrap().len(), written.topics.len());

    for (id, events_of) in [("ev3", 3), ("ev2", 3), ("davis", 3)] {
        let sent = packets(id);
        let found_messages = list(&messages[&format!("/{id}/events")]);
        assert_eq!(found_messages.len(), sent.len());
        let rows: Vec<_> = recording.events(id, ALWAYS_NS, EventClock::Session).unwrap().rows.iter().collect();
        let per_packet = 10 * events_of;
        for (n, (message, packet)) in found_messages.iter().zip(sent).enumerate() {
            assert_eq!((&message["log"], &message["seq"]), (&log_ns(packet), &json!(packet.sequence)), "{id}");
            assert_eq!((&message["encoding"], &message["is_bigendian"]), (&json!("evt3"), &json!(false)));
            let size = if id == "davis" { [346, 260] } else { recorded::EVENTS };
            assert_eq!(
                (&message["width"], &message["height"], &message["frame"]),
                (&json!(size[0]), &json!(size[1]), &json!(id))
            );
            if id == "ev3" {
                assert!(found.bytes(message, "bytes") == packet.payload, "as the sensor sent them");
            }
            let stamp_ns = message["stamp"].as_i64().unwrap() - EPOCH_NS;
            // The first 30 packets have 30 events each.
            if n < 30 && id != "davis" {
                let first = rows[n * per_packet];
                assert!((0..1000).contains(&(stamp_ns - 1000 * first.t_us)), "{id}: {stamp_ns}, {first:?}");
            }
            assert!(stamp_ns <= packet.host_ns - START_NS, "nothing is seen after it arrived");
        }
        assert_events(&events(&bag, &format!("{id}-events")), &events(&session, id), id);
    }

    for (id, pixels) in CAMERAS {
        check_camera(&found, (id, pixels), packets(id), &mut recording);
        assert!(written.damage.iter().any(|message| message.contains(&format!("1 frames of stream '{id}'"))), "{id}");
    }
    let frames: Vec<_> =
        recording.frames("davis", ALWAYS_NS, FrameLook::default()).unwrap().map(Result::unwrap).collect();
    let of_davis = list(&messages["/davis/image_raw"]);
    assert_eq!((of_davis.len(), frames.len()), (3, 3));
    for ((message, frame), sent) in of_davis.iter().zip(&frames).zip(recorded::davis_frames()) {
        assert_eq!((&message["encoding"], &message["step"]), (&json!("mono16"), &json!(692)));
        // The clock is asked for the middle in whole microseconds.
        assert!((message["stamp"].as_i64().unwrap() - EPOCH_NS - frame.exposure.mid_ns).abs() <= 1000);
        let words: Vec<u8> = sent.pixels.iter().flat_map(|pixel| (pixel << 6).to_le_bytes()).collect();
        assert!(found.bytes(message, "bytes") == words);
    }
    check_rig(&found, &rig);
}

fn check_camera(found: &Found, (id, pixels): (&str, PixelFormat), packets: &[Packet], recording: &mut TimedRecording) {
    let name = if id == "0deep" { "camera_0deep".to_owned() } else { id.replace('-', "_") };
    let compressed = pixels == PixelFormat::Mjpeg;
    let topic = format!("/{name}/image_raw{}", if compressed { "/compressed" } else { "" });
    let messages = list(&found.all["messages"][&topic]);
    let mids = recording.exposures(id).unwrap();
    let whole: Vec<&Packet> = packets.iter().filter(|packet| packet.sequence != 5).collect();
    assert_eq!((messages.len(), whole.len()), (FRAMES as usize - 1, FRAMES as usize - 1), "{topic}");
    for (message, packet) in messages.iter().zip(whole) {
        let offset_ns = if id == "grey-12" { -2_500_000 } else { 0 };
        let stamp = json!(EPOCH_NS + mids[&packet.sequence].mid_ns + offset_ns);
        assert_eq!((&message["log"], &message["stamp"], &message["frame"]), (&log_ns(packet), &stamp, &json!(id)));
        if compressed {
            let ours = pixel::decode(pixels, SIZE[0], SIZE[1], &packet.payload).unwrap().data;
            let theirs = found.bytes(message, "pixels");
            let off = theirs.iter().zip(&ours).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(message["format"] == "jpeg" && theirs.len() == ours.len() && off <= Some(4), "{off:?}");
            continue;
        }
        let (encoding, step, bytes) = expected_image(pixels, &packet.payload);
        assert_eq!((&message["encoding"], &message["step"]), (&json!(encoding), &json!(step)));
        assert_eq!((&message["width"], &message["height"]), (&json!(SIZE[0]), &json!(SIZE[1])));
        assert!(found.bytes(message, "bytes") == bytes, "{topic}");
    }
}

fn check_rig(found: &Found, rig: &RigFile) {
    let messages = &found.all["messages"];
    for (name, id, model) in [
        ("jpeg", "jpeg", "plumb_bob"),
        ("grey_12", "grey-12", "rational_polynomial"),
        ("ev3", "ev3", "equidistant"),
        ("davis", "davis", "plumb_bob"),
    ] {
        let camera = rig.camera(id).unwrap().intrinsics;
        let infos = list(&messages[&format!("/{name}/camera_info")]);
        let stamps = |topic: &str| -> Vec<&Value> { list(&messages[topic]).iter().map(|one| &one["stamp"]).collect() };
        let images =
            ["events", "image_raw", "image_raw/compressed"].map(|kind| stamps(&format!("/{name}/{kind}"))).concat();
        let mut of_images: Vec<i64> = images.into_iter().filter_map(Value::as_i64).collect();
        let mut of_infos: Vec<i64> = infos.iter().filter_map(|info| info["stamp"].as_i64()).collect();
        of_images.sort_unstable();
        of_infos.sort_unstable();
        assert!(!infos.is_empty() && of_images == of_infos, "{name}: one for each");
        let (fx, fy, cx, cy) = (camera.fx, camera.fy, camera.cx - 0.5, camera.cy - 0.5);
        for info in infos {
            assert_eq!((&info["distortion_model"], &info["frame"]), (&json!(model), &json!(id)));
            assert_eq!((&info["width"], &info["height"]), (&json!(camera.width), &json!(camera.height)));
            assert_eq!(numbers(&info["k"]), [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
            assert_eq!(numbers(&info["r"]), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
            assert_eq!(numbers(&info["p"]), [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
            assert_eq!(
                numbers(&info["d"]).len(),
                if model == "plumb_bob" { 5 } else { info["d"].as_array().unwrap().len() }
            );
        }
    }
    let [transforms] = list(&messages["/tf_static"]) else { panic!("one message") };
    let transforms = list(&transforms["transforms"]);
    assert_eq!(transforms.len(), 3);
    for transform in transforms {
        let pose = rig.camera(transform["frames"][1].as_str().unwrap()).unwrap().pose.unwrap();
        let [translation, rotation] = ["translation", "rotation"].map(|part| numbers(&transform[part]));
        let point = glam::DQuat::from_slice(&rotation) * glam::DVec3::Z + glam::DVec3::from_slice(&translation);
        assert!((pose.transform(point) - glam::DVec3::Z).length() < 1e-12);
        assert_eq!(transform["frames"][0], "world");
    }
}

#[test]
fn a_range_has_what_arrived_within_it() {
    let folder = tempfile::tempdir().unwrap();
    let (session, bag) = (folder.path().join("s.mcap"), folder.path().join("take \"2\": \\ #1"));
    recorded::write(&session);
    let mut recording = open(&session);
    let span_ns = Some([505_000_000, 650_000_000]);
    let streams = Some(vec!["ev2".to_owned(), "jpeg".to_owned()]);
    let choice = Rosbag2Choice { span_ns, streams, ..Rosbag2Choice::default() };
    rosbag2::write(&mut recording, &choice, &bag, |_, _| {}).unwrap();
    let found = events(&bag, "ev2-events");
    let all = events(&session, "ev2");
    let from = recorded::DEVICE_US + 500_000;
    let within: Vec<_> = all.iter().filter(|event| (from..from + 150_000).contains(&event.t_us)).collect();
    // A clock that rolled over before is told by the arrival alone, whole rounds off.
    let expected: Vec<_> = within.iter().map(|event| (event.t_us % (1 << 24), event.x, event.y, event.on)).collect();
    assert_eq!(found.iter().map(|event| (event.t_us, event.x, event.y, event.on)).collect::<Vec<_>>(), expected);
    let found = oracle::read("rosbag2", &bag);
    let frames = list(&found.all["messages"]["/jpeg/image_raw/compressed"]);
    assert_eq!(frames.len(), 5, "those that arrived at 510, 543, 576, 609 and 642 ms");
}

#[test]
fn a_place_that_is_taken_and_a_recording_with_nothing_leave_everything_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (session, bag) = (folder.path().join("s.mcap"), folder.path().join("bag"));
    recorded::write(&session);
    let mut recording = open(&session);
    std::fs::create_dir(&bag).unwrap();
    std::fs::write(bag.join("mine"), b"x").unwrap();
    let mut write = |id: &str, out: &Path| {
        let choice = Rosbag2Choice { streams: Some(vec![id.to_owned()]), ..Rosbag2Choice::default() };
        rosbag2::write(&mut recording, &choice, out, |_, _| {})
    };
    assert!(matches!(write("ev3", &bag), Err(BridgeError::Exists { .. })));
    let other = folder.path().join("other");
    assert!(matches!(write("dead", &other), Err(BridgeError::Nothing { .. })));
    assert!(matches!(write("board", &other), Err(BridgeError::NoCamera { .. })));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    assert_eq!(std::fs::read_dir(&bag).unwrap().count(), 1);
}
