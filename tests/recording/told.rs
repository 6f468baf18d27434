//! What `erfgs info` tells of a session, and what commands say of wrong usage.

use std::fs;

use erfgs_events::EventEncoding;
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings, Status, StreamStatus},
    source::{Encoding, Incident},
};
use serde_json::json;

use crate::recording::{
    files::{self, START_NS, erfgs},
    rig::{fail, recorded},
};

#[test]
fn info_tells_people_what_it_tells_programs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files::write_session(folder);
    files::json(folder, &["sync", "s.mcap", "--json"]);
    let info = |file: &str| String::from_utf8(erfgs(folder, &["info", file]).stdout).unwrap();
    let text = info("s.mcap");
    for word in
        ["2025-06-15 15:06:40 UTC", "with erfgs test", "firmware", "3.9.0", "A, hardware-triggered", "residual p50"]
    {
        assert!(text.contains(word), "no '{word}' in\n{text}");
    }

    let start = SessionStart { host_ns: START_NS, epoch_ns: 1_750_000_000_000_000_000, ..SessionStart::default() };
    let rig = "[rig]\nname = \"stage-left\"\n";
    let mut writer = SessionWriter::create(&folder.join("t.mcap"), start, rig, Settings::default()).unwrap();
    let settings = json!({
        "biases": { "diff_on": { "offset": 20, "value": 122 } },
        "usb": { "device": "1-2", "link": "5 Gbit/s" },
        "registers": { "0x0004": "0x0000ffff" },
        "not_applied": ["rate_hz = 30 (it has 25)"],
    });
    writer
        .add_stream(&files::description("ev0", Encoding::Events(EventEncoding::Evt3), [1280, 720], settings))
        .unwrap();
    let readings = [("temperature_c".to_owned(), Some(41.25))].into();
    let stream = StreamStatus { readings, ..StreamStatus::default() };
    let streams = [("ev0".to_owned(), stream)].into();
    writer.status(&Status { host_ns: START_NS, streams, ..Status::default() }).unwrap();
    writer.incident(None, START_NS, &Incident::Ended { reason: "the time was over".into() }).unwrap();
    writer.finish().unwrap();
    let text = info("t.mcap");
    for word in [
        "stage-left",
        "diff_on (offset 20, value 122)",
        "link 5 Gbit/s",
        "not_applied",
        "rate_hz = 30 (it has 25)",
        "temperature_c 41.250",
        "recorder: the recording ended: the time was over",
    ] {
        assert!(text.contains(word), "no '{word}' in\n{text}");
    }
    assert!(!text.contains("0x0000ffff"), "registers are for programs:\n{text}");
}

#[test]
fn a_recording_that_ended_in_good_order_has_no_warning() {
    let (folder, _) = recorded();
    let info = files::json(folder.path(), &["info", "take.mcap", "--json"]);
    let ended = info["incidents"].as_array().unwrap().last().unwrap();
    assert_eq!((&ended["kind"], &ended["reason"]), (&"ended".into(), &"the time was over".into()), "{info}");
}

#[test]
fn wrong_usage_is_refused_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files::write_session(folder);
    fs::write(folder.join("empty.toml"), "[rig]\nname = \"x\"\n").unwrap();
    fs::write(folder.join("rig.toml"), "[[pattern]]\nid = \"a\"\n").unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let live = format!("record rig.toml --out y.mcap --live {}", taken.local_addr().unwrap());
    for (code, words, hints) in [
        (2, "replay s.mcap --seek 100", &["--seek 100", "2.6"][..]),
        (2, "replay s.mcap --seek 100 --loop", &["--seek 100"]),
        (2, "replay none.mcap", &["none.mcap", "does not exist"]),
        (2, "replay .", &["folder", "event file"]),
        (2, "export none.mcap --to csv", &["none.mcap", "does not exist"]),
        (2, "export s.mcap --to raw --stream cam0", &["cam0", "grey8"]),
        (2, "record rig.toml --out x.mcap --seconds 1e30", &["--seconds", "1000000000"]),
        (2, "record rig.toml --out x.mcap --seconds 0", &["--seconds", "above 0"]),
        (2, "record empty.toml --out x.mcap", &["empty.toml", "no devices", "[[evk4]]"]),
        (2, "record rig.toml --out x.txt", &["--out x.mcap"]),
        (2, "record rig.toml --out takes.mcap --wait --live 127.0.0.1:0", &["--out takes", "folder"]),
        (1, live.as_str(), &["cannot serve a page", "another port"]),
        (2, "bench decode s.mcap", &["erfgs export s.mcap --to raw"]),
        (2, "info s.mcap.gz --check", &["--check"]),
    ] {
        let stderr = fail(folder, code, words);
        assert!(hints.iter().all(|hint| stderr.contains(hint)), "erfgs {words}: {stderr}");
        assert!(!stderr.contains("disk"), "nothing is tested before: {stderr}");
    }
    assert!(!folder.join("takes.mcap").exists() && !folder.join("x.mcap").exists());
    let help = |command: &str| String::from_utf8(erfgs(folder, &[command, "--help"]).stdout).unwrap();
    assert!(help("export").contains("an event file") && help("bench").contains("erfgs bench decode"));
}
