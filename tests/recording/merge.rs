//! The sessions of two hosts, merged by the program. What comes of it is tested to the microsecond in `rig/sync/tests`.

#[path = "../../rig/sync/tests/it/breaks/support.rs"]
#[allow(dead_code)]
pub mod support;

use std::{fs, path::Path};

use erfgs_events::EventEncoding;
use erfgs_session::{
    SessionWriter,
    container::{SessionStart, Settings},
    source::{Encoding, Packet},
};

use super::{
    files::json,
    rig::{fail, recorded},
};
use support::{MS, START_NS, board, camera, description, part};

/// A session whose host's clock is `ahead_ns` of the first one's.
fn write(path: &Path, ahead_ns: i64, streams: &[(&str, Encoding, Vec<Packet>)]) {
    let host_ns = START_NS + ahead_ns;
    let start = SessionStart { host_ns, epoch_ns: 1_000_000_000_000, ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).expect("a session");
    for (id, encoding, packets) in streams {
        let size = if encoding.is_events() { [1280, 720] } else { [0, 0] };
        let stream = writer.add_stream(&description(id, *encoding, size)).expect("a stream");
        for packet in packets {
            let packet = Packet { host_ns: packet.host_ns + ahead_ns, ..packet.clone() };
            writer.packet(stream, &packet).expect("written");
        }
    }
    writer.finish().expect("a whole session");
}

/// Writes `left.mcap`, of the host with the board, and `right.mcap` into `folder`.
pub fn write_hosts(folder: &Path) {
    let evt3 = Encoding::Events(EventEncoding::Evt3);
    let eye = |zero_ns, ppm| ("eye", evt3, camera(evt3, &[part(0, 4, zero_ns, ppm)], false).0);
    write(&folder.join("right.mcap"), -12_345_678 * MS, &[eye(-700 * MS, -60.0)]);
    write(&folder.join("left.mcap"), 0, &[eye(-3_000 * MS, 90.0), ("board", Encoding::TriggerLines, board(4))]);
}

#[test]
fn sessions_of_two_hosts_become_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    write_hosts(folder.path());

    let summary = json(folder.path(), &["merge", "right.mcap", "left.mcap", "--out", "take.mcap", "--json"]);
    assert_eq!(summary["reference"], "left.mcap", "the host with the board gives the clock: {summary}");
    let streams: Vec<&str> =
        summary["streams"].as_array().expect("streams").iter().filter_map(|row| row["stream"].as_str()).collect();
    assert_eq!(streams, ["eye", "board", "right-eye"], "{summary}");
    assert!(summary["sessions"][0]["common"].as_u64() > Some(90), "{summary}");
    let synced = json(folder.path(), &["sync", "take.mcap", "--json"]);
    for row in synced["streams"].as_array().expect("streams") {
        assert_eq!(row["tier"], "hardware-triggered", "{synced}");
    }
    let stderr = fail(folder.path(), 1, "merge right.mcap left.mcap --out take.mcap");
    assert!(stderr.contains("exists already"), "{stderr}");
    fs::remove_file(path("take.mcap")).expect("removed");

    // A rig that no pulses reach.
    let (alone, _) = recorded();
    fs::copy(alone.path().join("take.mcap"), path("alone.mcap")).expect("copied");
    let stderr = fail(folder.path(), 1, "merge left.mcap alone.mcap --out take.mcap");
    assert!(stderr.contains("alone.mcap") && stderr.contains("holds no pulses of a trigger board"), "{stderr}");
    fail(folder.path(), 2, "merge left.mcap --out take.mcap");
    assert!(!path("take.mcap").exists(), "nothing is written of what is refused");
}
