//! Recordings of rosbag2 in SQLite.

use std::path::Path;

use erfgs_events::Columns;
use erfgs_session::container::Session;
use rusqlite::{Connection, params};

use crate::common::event_packet;

fn bag(path: &Path, kind: &str, messages: &[Vec<u8>]) {
    let bag = Connection::open(path).unwrap();
    bag.execute_batch(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL, \
         offered_qos_profiles TEXT NOT NULL);
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);
         INSERT INTO topics VALUES (1, '/rosout', 'rcl_interfaces/msg/Log', 'cdr', '');
         INSERT INTO messages VALUES (1, 1, 7, x'00');",
    )
    .unwrap();
    bag.execute("INSERT INTO topics VALUES (2, '/event_camera/events', ?1, 'cdr', '')", [kind]).unwrap();
    for (at, message) in messages.iter().enumerate() {
        let time = 1_700_000_000_000_000_000_i64 + at as i64 * 1_000_000;
        bag.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (2, ?1, ?2)", params![time, message])
            .unwrap();
    }
}

/// A word of `mono`: nanoseconds after the base, column, row, polarity.
fn mono(ns: u32, x: u16, y: u16, on: bool) -> [u8; 8] {
    (u64::from(on) << 63 | u64::from(y) << 48 | u64::from(x) << 32 | u64::from(ns)).to_le_bytes()
}

/// A pair of `libcaer`: column, row, polarity, and microseconds after the base.
fn libcaer(us: u32, x: u32, y: u32, on: bool) -> [u8; 8] {
    let data = x << 17 | y << 2 | u32::from(on) << 1 | 1;
    (u64::from(us) << 32 | u64::from(data)).to_le_bytes()
}

#[test]
fn events_of_a_bag_in_sqlite_are_those_of_its_messages() {
    let folder = tempfile::tempdir().unwrap();
    // The base of the messages is 123 ns.
    let pairs = [
        libcaer(10, 3, 4, true),
        libcaer(20, 639, 479, false),
        libcaer(0x7FFF_FFFF, 1, 1, true),
        libcaer(5, 2, 2, true),
    ];
    let words = [mono(10_000, 3, 4, true), mono(20_900, 639, 479, false), mono(20_900, 640, 0, false)];
    for (name, encoding, payload, times) in [
        ("a.db3", "mono", words.concat(), vec![10, 21]),
        ("b.db3", "libcaer", pairs.concat(), vec![10, 20, 0x7FFF_FFFF, 0x8000_0005]),
    ] {
        let path = folder.path().join(name);
        bag(&path, "event_camera_msgs/msg/EventPacket", &[event_packet(0, encoding, &payload)]);
        let before = std::fs::read(&path).unwrap();
        let mut session = Session::open(&path).unwrap();
        let summary = session.summary().clone();
        assert_eq!((summary.streams.len(), summary.file_bytes), (1, before.len() as u64));
        assert_eq!(summary.streams[0].description.id, "event_camera-events");
        assert_eq!(summary.start.host_ns, 1_700_000_000_000_000_000);
        let mut columns = Columns::default();
        let decoded = session.decode_events(0, None, &mut columns, |_| {}).unwrap().unwrap();
        assert!(decoded.damage.is_empty(), "{decoded:?}");
        assert_eq!(decoded.anomalies.outside, u64::from(encoding == "mono"), "column 640 of 640");
        let since: Vec<u64> = columns.t_us.iter().map(|t_us| t_us - columns.t_us[0] + times[0]).collect();
        assert_eq!(since, times, "whole microseconds after the base, over the rounds of both clocks");
        assert_eq!((columns.x[..2].to_vec(), columns.y[..2].to_vec()), (vec![3, 639], vec![4, 479]));
        assert_eq!(columns.on[..2], [true, false]);
        assert_eq!(std::fs::read(&path).unwrap(), before, "the bag is left alone");
    }
}

#[test]
fn messages_that_rosbag2_compressed_one_by_one_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let words = |from: u32| -> Vec<u8> { (from..from + 40).flat_map(|n| mono(n * 1000, 3, 4, n % 2 == 0)).collect() };
    let messages: Vec<Vec<u8>> = (0..3).map(|n| event_packet(n.into(), "mono", &words(40 * n))).collect();
    let fast = ruzstd::encoding::CompressionLevel::Fastest;
    let packed: Vec<Vec<u8>> =
        messages.iter().map(|message| ruzstd::encoding::compress_to_vec(&message[..], fast)).collect();
    let events = |name: &str, messages: &[Vec<u8>]| {
        let path = folder.path().join(name);
        bag(&path, "event_camera_msgs/msg/EventPacket", messages);
        let mut session = Session::open(&path).unwrap();
        let mut columns = Columns::default();
        let decoded = session.decode_events(0, None, &mut columns, |_| {}).unwrap().unwrap();
        (columns, decoded.damage.len())
    };
    let (plain, packed_columns) = (events("a.db3", &messages), events("b.db3", &packed));
    assert_eq!((plain.0.len(), plain.1), (120, 0));
    assert_eq!(plain, packed_columns);
    let mut cut = packed;
    let half = cut[1].len() / 2;
    cut[1].truncate(half);
    assert_eq!(events("c.db3", &cut).0.len(), 80, "what is whole is read");
}

#[test]
fn bags_without_events_and_broken_ones_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let error = |name: &str| Session::open(&folder.path().join(name)).err().unwrap().to_string();
    bag(&folder.path().join("a.db3"), "sensor_msgs/msg/Image", &[vec![0; 10]]);
    let text = error("a.db3");
    assert!(text.contains("a.db3") && text.contains("sensor_msgs/msg/Image"), "{text}");
    bag(&folder.path().join("b.db3"), "event_camera_msgs/msg/EventPacket", &[event_packet(0, "mono", &[0; 8])]);
    let bytes = std::fs::read(folder.path().join("b.db3")).unwrap();
    std::fs::write(folder.path().join("c.db3"), &bytes[..200]).unwrap();
    assert!(error("c.db3").contains("rosbag2"), "{}", error("c.db3"));
    // Damage is told or changes numbers; nothing panics.
    for at in (100..bytes.len()).step_by(97) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0xFF;
        std::fs::write(folder.path().join("d.db3"), damaged).unwrap();
        let _ = Session::open(&folder.path().join("d.db3"));
    }
}

#[test]
fn a_folder_of_rosbag2_is_the_recording_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let words: Vec<u8> = (0..5).flat_map(|n| mono(n * 1000, 3, 4, true)).collect();
    bag(
        &path.join("a_0.db3"),
        "event_camera_msgs/msg/EventPacket",
        &[event_packet(1_700_000_000_000_000_000, "mono", &words)],
    );
    let count = |path: &Path| {
        let mut columns = Columns::default();
        let recording = erfgs_session::Recording::open(path, None);
        recording.map(|mut recording| recording.decode_events(0, &mut columns, |_| {}).map(|_| columns.len()).unwrap())
    };
    assert!(count(path).is_err(), "no folder of rosbag2");
    std::fs::write(path.join("metadata.yaml"), "rosbag2_bagfile_information:\n").unwrap();
    assert_eq!(count(path).unwrap(), 5);
    assert_eq!(Session::open(path).unwrap().path(), path.join("a_0.db3"));
    std::fs::copy(path.join("a_0.db3"), path.join("a_1.db3")).unwrap();
    let message = count(path).err().unwrap().to_string();
    assert!(message.contains("2 files") && message.contains("a_1.db3"), "{message}");
}
