//! The files of several cameras in a folder, drafted as a plan and imported as a session, as a user does it.

use std::fs;

use erfgs_events::{CdEvent, Edge, EventEncoding, Evt3Encoder, RawHeader, SensorSize};
use erfgs_scene::ImageRgb8;

use crate::recording::files::{erfgs, json};

/// An event camera that saw 30 pulses in a second, and a folder with a picture for each.
fn files(folder: &std::path::Path) {
    let size = SensorSize { width: 64, height: 40 };
    let mut bytes = RawHeader::new(EventEncoding::Evt3, size, "7", "2026-11-30 12:00:00").unwrap().encode();
    let mut encoder = Evt3Encoder::default();
    for ms in 0..1100_u64 {
        if (40..1030).contains(&ms) && (ms - 40) % 33 < 2 {
            let rising = (ms - 40) % 33 == 0;
            encoder.edge(Edge { t_us: 1000 * ms + 7, channel: 0, rising }, &mut bytes).unwrap();
        }
        encoder.event(CdEvent { t_us: 1000 * ms + 500, x: 3, y: 4, on: ms % 2 == 0 }, &mut bytes).unwrap();
    }
    encoder.finish(&mut bytes);
    fs::write(folder.join("eye.raw"), bytes).unwrap();
    fs::create_dir(folder.join("rgb 0")).unwrap();
    for index in 0..30 {
        ImageRgb8::new(16, 8).write_png(&folder.join(format!("rgb 0/{index}.png"))).unwrap();
    }
}

#[test]
fn a_folder_of_recordings_becomes_a_session_by_its_plan() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let recordings = folder.join("recordings");
    fs::create_dir(&recordings).unwrap();
    let refused = |words: &[&str], says: &str| {
        let output = erfgs(folder, words);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(says), "{says}: {message}");
    };
    refused(&["import", "recordings"], "no event file, no video and no folder of pictures");
    files(&recordings);
    let drafted = json(folder, &["import", "recordings", "--json"]);
    assert_eq!((&drafted["events"], &drafted["frames"]), (&1.into(), &1.into()), "{drafted}");
    refused(&["import", "recordings"], "import.toml exists already");
    // As many frames as pulses: nothing is left to be said.
    let imported = json(folder, &["import", "recordings/import.toml", "--out", "take.mcap", "--json"]);
    assert_eq!(imported["streams"][1]["id"], "rgb-0", "{imported}");
    assert_eq!(imported["streams"][1]["packets"], 30);
    json(folder, &["info", "take.mcap", "--check", "--json"]);
    let synced = json(folder, &["sync", "take.mcap", "--json"]);
    assert_eq!(
        (&synced["streams"][0]["tier"], &synced["streams"][1]["tier"]),
        (&"strobe".into(), &"strobe".into()),
        "{synced}"
    );
    refused(&["import", "recordings/import.toml", "--size", "4x4"], "--size is of one event file");
    refused(&["import", "recordings", "--out", "x.mcap"], "a plan is drafted first");
    refused(&["import", "recordings/import.toml", "--out", "x.raw"], "sessions end in .mcap");
    refused(&["import", "recordings/none.toml"], "none.toml");
}
