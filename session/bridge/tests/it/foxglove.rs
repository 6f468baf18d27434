//! Foxglove's messages, decoded by the library of MCAP by their schemas in the file, by Foxglove's own classes, and by OpenCV.

use std::{collections::BTreeSet, path::Path};

use erfgs_bridge::{
    BridgeError,
    foxglove::{self, EventPictures, FoxgloveChoice},
};
use erfgs_events::EventFileHints;
use erfgs_scene::{Distortion, rig_file::RigFile};
use erfgs_sync::reading::{ALWAYS_NS, Depth, EventClock, FrameLook, Samples, TimedFrame, TimedRecording};
use serde_json::{Value, json};

use crate::{
    oracle::{self, Found, list, numbers},
    recorded::{self, CAMERAS, EPOCH_NS, EVENTS, FRAMES},
};

const PERIOD_NS: i64 = 20_000_000;

fn open(path: &Path) -> TimedRecording {
    TimedRecording::open(path, &EventFileHints::default()).unwrap()
}

fn frames(recording: &mut TimedRecording, id: &str) -> Vec<TimedFrame> {
    let look = FrameLook { depth: Depth::OfCamera, bits: None };
    recording.frames(id, ALWAYS_NS, look).unwrap().map(Result::unwrap).collect()
}

/// Whether a message has the time, to the nanosecond.
fn assert_time(message: &Value, session_ns: i64, what: &str) {
    let expected = json!(EPOCH_NS + session_ns);
    assert_eq!((&message["log"], &message["stamp"]), (&expected, &expected), "{what}");
}

fn assert_picture(found: &Found, message: &Value, frame: &TimedFrame, what: &str) {
    let pixels = found.bytes(message, "pixels");
    let depth = message["depth"].as_u64().unwrap();
    let colours = if frame.picture.channels == 3 { vec![3] } else { Vec::new() };
    let shape = [vec![frame.picture.height, frame.picture.width], colours].concat();
    assert_eq!(message["shape"], json!(shape), "{what}");
    match (&frame.jpeg, &frame.picture.samples) {
        (Some(jpeg), Samples::Bits8(levels)) => {
            assert_eq!(message["format"], "jpeg");
            assert!(found.bytes(message, "bytes") == *jpeg, "{what}: as the camera sent it");
            // Decoders round in ways of their own.
            let off = pixels.iter().zip(levels).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(pixels.len() == levels.len() && off <= Some(4), "{what}: {off:?} levels off");
        }
        (None, Samples::Bits8(levels)) => {
            assert!(message["format"] == "png" && depth == 1 && pixels == *levels, "{what}")
        }
        (_, Samples::Bits16(levels)) => {
            let words: Vec<u8> = levels.iter().flat_map(|level| level.to_le_bytes()).collect();
            assert!(message["format"] == "png" && depth == 2 && pixels == words, "{what}");
        }
    }
}

/// Where a picture of events is not black.
fn lit(found: &Found, message: &Value) -> BTreeSet<usize> {
    let pixels = found.bytes(message, "pixels");
    (0..).zip(pixels.chunks(3)).filter(|(_, pixel)| *pixel != [16, 19, 26]).map(|(at, _)| at).collect()
}

#[test]
fn others_read_every_picture_lens_and_pose_with_its_time() {
    let folder = tempfile::tempdir().unwrap();
    let (session, out) = (folder.path().join("s.mcap"), folder.path().join("out/s.foxglove.mcap"));
    recorded::write(&session);
    let rig = recorded::rig();
    let mut recording = open(&session);
    let events = EventPictures { rate_hz: 50.0, span_ns: None };
    let choice = FoxgloveChoice { rig: Some(&rig), events, ..FoxgloveChoice::default() };
    let mut last = (0, 0);
    let written = foxglove::write(&mut recording, &choice, &out, |done, total| last = (done, total)).unwrap();
    assert!(last.0 == last.1 && last.1 > 0, "{last:?}");
    let found = oracle::read("foxglove", &out);
    let topics = found.all.as_object().unwrap();
    for topic in &written.topics {
        assert_eq!(topics[&topic.topic].as_array().unwrap().len() as u64, topic.messages, "{}", topic.topic);
    }
    assert_eq!(topics.len(), written.topics.len());
    for id in ["dead", "silent", "board", "elsewhere"] {
        assert!(!topics.keys().any(|topic| topic.contains(&format!("/{id}/"))), "{id}");
    }
    for (id, _) in CAMERAS {
        let expected = frames(&mut recording, id);
        let messages = list(&topics[&format!("/{id}/image")]);
        assert_eq!((messages.len(), expected.len()), (FRAMES as usize - 1, FRAMES as usize - 1), "{id}");
        for (message, frame) in messages.iter().zip(&expected) {
            let offset_ns = if id == "grey-12" { -2_500_000 } else { 0 };
            assert_time(message, frame.exposure.mid_ns + offset_ns, id);
            assert_eq!((&message["frame"], &message["sequence"]), (&json!(id), &json!(frame.sequence)));
            assert_picture(&found, message, frame, id);
        }
        assert!(written.damage.iter().any(|message| message.contains(&format!("1 frames of stream '{id}'"))), "{id}");
    }
    let expected = frames(&mut recording, "davis");
    let messages = list(&topics["/davis/image"]);
    assert_eq!((messages.len(), expected.len()), (3, 3));
    for (message, frame) in messages.iter().zip(&expected) {
        assert_time(message, frame.exposure.mid_ns, "davis");
        assert_picture(&found, message, frame, "davis");
    }
    for id in ["ev3", "ev2"] {
        let events: Vec<_> = recording.events(id, ALWAYS_NS, EventClock::Session).unwrap().rows.iter().collect();
        let messages = list(&topics[&format!("/{id}/events")]);
        // 300 ms, a black one, and 300 ms.
        assert!((30..=34).contains(&messages.len()), "{id}: {} pictures", messages.len());
        let mut shown = 0;
        for message in messages {
            let end_ns = message["log"].as_i64().unwrap() - EPOCH_NS;
            assert_time(message, end_ns, id);
            assert_eq!(message["shape"], json!([EVENTS[1], EVENTS[0], 3]));
            let last_picture = end_ns % PERIOD_NS != 0;
            assert!(!last_picture || message == messages.last().unwrap(), "{id} at {end_ns}");
            let within = |t_us: i64| (end_ns - PERIOD_NS..end_ns).contains(&(1000 * t_us));
            let seen: Vec<_> = events.iter().filter(|event| within(event.t_us)).collect();
            let at =
                |event: &&&erfgs_events::Event| usize::from(event.y) * usize::from(EVENTS[0]) + usize::from(event.x);
            assert_eq!(lit(&found, message), seen.iter().map(|event| at(&event)).collect(), "{id} at {end_ns}");
            shown += seen.len();
        }
        // What is left over at the end lies in two pictures.
        assert!(shown >= events.len() && events.len() == recorded::events().len(), "{id}: {shown}");
    }
    check_rig(topics, &rig);
    assert_eq!(written.notes.iter().filter(|note| note.contains("is not in the rig file")).count(), 7);
}

fn check_rig(topics: &serde_json::Map<String, Value>, rig: &RigFile) {
    let first = topics.values().flat_map(list).map(|message| message["log"].as_i64().unwrap()).min().unwrap();
    let transforms = list(&topics["/tf"]);
    assert_eq!((transforms.len(), &transforms[0]["log"]), (1, &json!(first)), "before all pictures");
    let transforms = list(&transforms[0]["transforms"]);
    assert_eq!(transforms.len(), 3);
    for transform in transforms {
        let id = transform["frames"][1].as_str().unwrap();
        assert_eq!((&transform["frames"][0], &transform["stamp"]), (&json!("world"), &json!(first)));
        let pose = rig.camera(id).unwrap().pose.unwrap();
        let [translation, rotation] = ["translation", "rotation"].map(|part| numbers(&transform[part]));
        let rotation = glam::DQuat::from_slice(&rotation);
        // A point before the camera, in the world.
        let point = rotation * glam::DVec3::new(0.3, -0.4, 2.0) + glam::DVec3::from_slice(&translation);
        assert!((pose.transform(point) - glam::DVec3::new(0.3, -0.4, 2.0)).length() < 1e-12, "{id}");
    }
    for (id, model) in
        [("jpeg", "plumb_bob"), ("grey-12", "rational_polynomial"), ("ev3", "kannala_brandt"), ("davis", "plumb_bob")]
    {
        let camera = &rig.camera(id).unwrap().intrinsics;
        let [message] = list(&topics[&format!("/{id}/calibration")]) else { panic!("{id}") };
        assert_eq!((&message["log"], &message["stamp"], &message["frame"]), (&json!(first), &json!(first), &json!(id)));
        assert_eq!((&message["size"], &message["model"]), (&json!([camera.width, camera.height]), &json!(model)));
        let coefficients = match camera.distortion {
            Distortion::None => vec![0.0; 5],
            Distortion::BrownConrady(k) if model == "plumb_bob" => k[..5].to_vec(),
            Distortion::BrownConrady(k) => k.to_vec(),
            Distortion::KannalaBrandt(k) => k.to_vec(),
        };
        assert_eq!(numbers(&message["D"]), coefficients, "{id}");
        // Whole numbers are the centres of pixels there.
        let (fx, fy, cx, cy) = (camera.fx, camera.fy, camera.cx - 0.5, camera.cy - 0.5);
        assert_eq!(numbers(&message["K"]), [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
        assert_eq!(numbers(&message["R"]), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(numbers(&message["P"]), [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    }
}

#[test]
fn a_stream_a_span_and_small_files_can_be_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (session, out) = (folder.path().join("s.mcap"), folder.path().join("s.foxglove.mcap"));
    recorded::write(&session);
    let mut recording = open(&session);
    let all = frames(&mut recording, "grey-12");
    let span = [all[8].exposure.mid_ns, all[11].exposure.mid_ns];
    let streams = Some(vec!["grey-12".to_owned()]);
    let choice = FoxgloveChoice { streams, span_ns: Some(span), jpeg: Some(95), ..FoxgloveChoice::default() };
    foxglove::write(&mut recording, &choice, &out, |_, _| {}).unwrap();
    let found = oracle::read("foxglove", &out);
    let messages = list(&found.all["/grey-12/image"]);
    assert_eq!((found.all.as_object().unwrap().len(), messages.len()), (1, 3));
    for (message, frame) in messages.iter().zip(&all[8..11]) {
        assert_time(message, frame.exposure.mid_ns, "grey-12");
        assert_eq!((&message["format"], &message["depth"]), (&json!("jpeg"), &json!(1)));
        let Samples::Bits16(levels) = &frame.picture.samples else { panic!() };
        let near =
            found.bytes(message, "pixels").chunks(3).zip(levels).all(|(p, l)| p[0].abs_diff((l / 257) as u8) < 12);
        assert!(near, "the picture in 8 bits");
    }
}

#[test]
fn what_cannot_be_written_is_named_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (session, out) = (folder.path().join("s.mcap"), folder.path().join("s.foxglove.mcap"));
    recorded::write(&session);
    let mut recording = open(&session);
    let mut write = |choice: FoxgloveChoice<'_>| foxglove::write(&mut recording, &choice, &out, |_, _| {});
    let only = |id: &str| FoxgloveChoice { streams: Some(vec![id.to_owned()]), ..FoxgloveChoice::default() };
    assert!(matches!(write(only("dead")), Err(BridgeError::Nothing { .. })));
    let message = write(only("board")).unwrap_err().to_string();
    assert!(message.contains("'board'") && message.contains("trigger board"), "{message}");
    let message = write(only("ev9")).unwrap_err().to_string();
    assert!(message.contains("ev9") && message.contains("davis"), "{message}");
    let mut other = recorded::rig();
    other.cameras.retain(|camera| camera.name == "elsewhere");
    let message = write(FoxgloveChoice { rig: Some(&other), ..FoxgloveChoice::default() }).unwrap_err().to_string();
    assert!(message.contains("elsewhere") && message.contains("grey-12"), "{message}");
    let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["s.mcap"]);
}
