//! The files of several cameras in a folder, drafted as a plan and imported as a session, as a user does it.

use std::{fs, path::Path};

use erfgs_emulated_rig::{Act, Plan, record};
use erfgs_events::{CdEvent, Edge, EventEncoding, Evt3Encoder, RawHeader, SensorSize};
use erfgs_scene::ImageRgb8;
use erfgs_session::container::Session;
use erfgs_sync::{SyncOptions, Synchronisation, Tier, synchronise};

use crate::recording::files::{erfgs, json};

/// An event camera that saw 30 pulses in a second, and a folder with a picture for each.
fn files(folder: &Path) {
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

/// The synchronisation of a session.
fn synchronised(path: &Path) -> Synchronisation {
    synchronise(&mut Session::open(path).unwrap(), SyncOptions::default(), |_| {}).unwrap()
}

/// The rate of an event camera's clock beside that of another, parts per million.
fn apart_ppm(sync: &Synchronisation, id: &str, other: &str) -> f64 {
    let [a, b] = [id, other].map(|id| sync.stream(id).unwrap().epochs.clocks().next().unwrap().rate_error_ppm());
    a - b
}

#[test]
fn what_a_rig_recorded_comes_back_from_its_files_on_one_clock() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let plan = Plan { performance_s: 0.4, ..Plan::small().unwrap() };
    record(&plan, Act::Performance, &folder.join("take.mcap"), &|_, _| {}).unwrap();
    // Frames are exported with the times that it finds.
    json(folder, &["sync", "take.mcap", "--json"]);
    let take = synchronised(&folder.join("take.mcap"));
    fs::create_dir(folder.join("files")).unwrap();
    json(folder, &["export", "take.mcap", "--to", "raw", "--out", "files", "--json"]);
    json(folder, &["export", "take.mcap", "--to", "png", "--out", "files", "--json"]);
    json(folder, &["import", "files", "--json"]);
    // The draft knows what belongs to the pulses; exposures, and free cameras, are a person's to tell.
    let mut text = String::new();
    for block in fs::read_to_string(folder.join("files/import.toml")).unwrap().split("\n\n") {
        let id = block.lines().find_map(|line| line.strip_prefix("id = ")).unwrap_or_default().trim_matches('"');
        let described = plan.cameras.iter().any(|camera| camera.id == id);
        assert!(described || !block.contains("[["), "{block}");
        let triggered = "# exposure_us = 5000";
        let free = format!(
            "times = \"{id}/frames.csv\"\ncolumn = \"exposure_mid_ns\"\nmarks = \"middle\"\nexposure_us = 5000\n#"
        );
        let block = match &id[..id.len().min(3)] {
            "rgb" => block.replace(triggered, "exposure_us = 33000"),
            "fre" => block.replace("# times = \"times.csv\"", &free),
            _ => block.to_owned(),
        };
        text += &format!("{block}\n\n");
    }
    fs::write(folder.join("files/import.toml"), text).unwrap();
    json(folder, &["import", "files/import.toml", "--out", "again.mcap", "--json"]);
    let again = synchronised(&folder.join("again.mcap"));
    let ids = |prefix: &'static str| {
        plan.cameras.iter().map(|camera| camera.id.as_str()).filter(move |id| id.starts_with(prefix))
    };
    let eyes: Vec<&str> = take
        .streams
        .iter()
        .filter(|stream| stream.epochs.clocks().next().is_some())
        .map(|stream| stream.id.as_str())
        .filter(|id| again.stream(id).is_some())
        .collect();
    assert!(eyes.len() >= 2 && ids("rgb").count() >= 2, "{eyes:?}");
    // Event cameras' clocks run as apart as the board's numbered pulses said.
    for eye in &eyes[1..] {
        let apart = [&take, &again].map(|sync| apart_ppm(sync, eye, eyes[0]));
        assert!((apart[0] - apart[1]).abs() < 1.0, "{eye}: {apart:?}");
    }
    // Frames lie between each other's as they did, on the clock of another crystal.
    let of = |sync: &Synchronisation, id: &str| sync.stream(id).unwrap().exposures.clone().unwrap().mid_ns;
    let first = ids("rgb").next().unwrap();
    let [began, begins] = [&take, &again].map(|sync| of(sync, first)[0]);
    for id in ids("rgb") {
        let (before, after) = (of(&take, id), of(&again, id));
        assert_eq!(before.len(), after.len(), "{id}");
        for (before, after) in before.iter().zip(&after) {
            let off = (before - began) - (after - begins);
            assert!(off.abs() < 1000 + (before - began) / 5000, "{id}: {off}");
        }
        assert_eq!(again.stream(id).unwrap().tier, Tier::HardwareTriggered);
    }
}
