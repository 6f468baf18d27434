//! Rigs of devices as files describe them.

use std::fs;

use erfgs_events::{CSV_HEADER, CdEvent, CsvEncoder, Event, Events, npz};
use erfgs_hardware_mocks::usb::{
    Fault, FaultKind,
    evk4::STREAM,
    front::usbip::Device,
    rigfile::{RigError, RigFile},
    uvc::FrameTruth,
};
use serde_json::json;

use super::{evk4, host::Bench, uvc};

fn rig(text: &str) -> Result<RigFile, RigError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    fs::write(&path, text).unwrap();
    RigFile::open(&path)
}

fn device(fields: &str) -> Result<Bench<Device>, RigError> {
    let text = format!("[[device]]\nname = \"one\"\n{fields}");
    Ok(Bench::new(rig(&text)?.build()?.devices.swap_remove(0).device))
}

fn problem(fields: &str) -> String {
    device(fields).err().unwrap_or_else(|| panic!("{fields} is taken")).to_string()
}

#[test]
fn the_example_of_the_documentation_is_a_rig() {
    let source = include_str!("../../src/usb/rigfile/mod.rs");
    let example = source.split("//! ```toml\n").nth(1).and_then(|rest| rest.split("//! ```").next()).unwrap();
    let lines: Vec<&str> = example.lines().map(|line| line.trim_start_matches("//!").trim_start()).collect();
    let rig = rig(&lines.join("\n")).unwrap();
    let faults = &rig.devices[0].faults;
    assert_eq!(faults.schedule, [Fault { at_ms: 5000, kind: FaultKind::Unplug { for_ms: 2000 } }]);
    assert_eq!(rig.build().unwrap().devices.len(), 1);
}

#[test]
fn every_fault_can_be_written_and_what_it_does_not_have_is_refused() {
    let fields = |schedule: &str| {
        format!("kind = \"evk4\"\nserial = \"1\"\n[device.faults]\nschedule = [ {{ at_ms = 10, {schedule} }} ]")
    };
    let cases = [
        ("kind = \"nak\", endpoint = 129, for_ms = 5", FaultKind::Nak { endpoint: 0x81, for_ms: 5 }),
        ("kind = \"stall\", endpoint = 0x81", FaultKind::Stall { endpoint: 0x81 }),
        (
            "kind = \"short-read\", endpoint = 129, bytes = 3, lost = true",
            FaultKind::ShortRead { endpoint: 0x81, bytes: 3, lost: true },
        ),
        (
            "kind = \"corrupt-word\", endpoint = 129, word = 2, bits = 0x8000",
            FaultKind::CorruptWord { endpoint: 0x81, word: 2, bits: 0x8000 },
        ),
        ("kind = \"lost-transfer\", endpoint = 129", FaultKind::LostTransfer { endpoint: 0x81 }),
        ("kind = \"unplug\", for_ms = 0", FaultKind::Unplug { for_ms: 0 }),
    ];
    for (text, kind) in cases {
        let rig = rig(&format!("[[device]]\nname = \"one\"\n{}", fields(text))).unwrap();
        assert_eq!(rig.devices[0].faults.schedule, [Fault { at_ms: 10, kind }]);
    }
    assert!(problem(&fields("kind = \"stall\", endpoint = 129, for_ms = 5")).contains("for_ms"));
    assert!(problem(&fields("kind = \"stall\"")).contains("endpoint"));
    assert!(problem(&fields("kind = \"stahl\", endpoint = 129")).contains("short-read"));
}

#[test]
fn fields_that_a_device_does_not_have_are_refused_by_name() {
    let evk4 = "kind = \"evk4\"\nserial = \"1\"\n";
    let davis = "kind = \"davis346\"\nserial = \"1\"\n";
    let uvc = "kind = \"uvc\"\nserial = \"1\"\n";
    for (fields, word) in [
        (format!("{davis}raw = \"a.raw\""), "raw"),
        (format!("{uvc}events = \"a.raw\""), "events"),
        (format!("{uvc}latency_ms = 3"), "latency_ms"),
        (format!("{uvc}queue_mib = 3"), "queue_mib"),
        (format!("{evk4}rates_hz = [10.0]"), "rates_hz"),
        (format!("{evk4}slave = true"), "slave"),
        (format!("{evk4}dataset = \"ds\""), "camera"),
        (format!("{evk4}stage = true\nraw = \"a.raw\""), "one thing"),
        (format!("{evk4}events = \"no-such-file.raw\""), "no-such-file.raw"),
        (format!("{uvc}dataset = \"no-such-folder\"\ncamera = \"a\""), "no-such-folder"),
    ] {
        let problem = problem(&fields);
        assert!(problem.contains(word), "{problem}");
    }
}

/// Events at 1000 a second, the first after 5 s.
fn take(count: u64) -> Vec<CdEvent> {
    (0..count).map(|k| CdEvent { t_us: 5_000_000 + 1000 * k, x: k as u16, y: (k / 2) as u16, on: k % 3 == 0 }).collect()
}

/// What an EVK4 of a rig file sends of a take of 100 ms that it plays: the positions of its events, over 250 ms.
fn played(fields: &str) -> Vec<(u16, u16, bool)> {
    let mut host = device(&format!("kind = \"evk4\"\nserial = \"1\"\n{fields}")).unwrap();
    evk4::run(&mut host, evk4::INIT);
    evk4::run(&mut host, evk4::START);
    let events = evk4::evt3(&host.listen(STREAM, 16_384, 250_000)).events;
    events.iter().map(|event| (event.x, event.y, event.on)).collect()
}

fn assert_laps(played: &[(u16, u16, bool)]) {
    let take: Vec<_> = take(100).iter().map(|event| (event.x, event.y, event.on)).collect();
    assert!((230..=260).contains(&played.len()), "{} events", played.len());
    let first = take.iter().position(|event| *event == played[0]).unwrap();
    for (offset, event) in played.iter().enumerate() {
        assert_eq!(*event, take[(first + offset) % 100], "event {offset}");
    }
}

#[test]
fn an_event_camera_plays_a_file_again_and_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("take.csv");
    let mut csv = CSV_HEADER.to_vec();
    take(100).into_iter().for_each(|event| CsvEncoder.event(event, &mut csv));
    fs::write(&path, &csv).unwrap();
    assert_laps(&played(&format!("events = {path:?}")));
    // A sensor of 346 columns cannot play it all.
    take(100).into_iter().for_each(|event| CsvEncoder.event(CdEvent { x: event.x + 300, ..event }, &mut csv));
    fs::write(&path, csv).unwrap();
    let problem = problem(&format!("kind = \"davis346\"\nserial = \"1\"\nevents = {path:?}"));
    assert!(problem.contains("346 x 260"), "{problem}");
}

#[test]
fn devices_play_the_cameras_of_a_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let mut events = Events::new(1280, 720);
    for CdEvent { t_us, x, y, on } in take(100) {
        events.push(Event { t_us: t_us as i64, x, y, on });
    }
    fs::create_dir(root.join("events")).unwrap();
    npz::write_events(&root.join("events/left.npz"), &events).unwrap();
    let levels = [20_u8, 120, 220, 60];
    let frame = |k: usize| {
        let file = format!("{k}.png");
        let data = vec![levels[k]; 160 * 120 * 3];
        erfgs_scene::image::ImageRgb8 { width: 160, height: 120, data }.write_png(&root.join(&file)).unwrap();
        let t_ns = 5_000_000_000 + 25_000_000 * k as i64;
        json!({ "file": file, "t_ns": t_ns, "exposure_ns": [t_ns, t_ns] })
    };
    let frames: Vec<_> = (0..levels.len()).map(frame).collect();
    let camera = |name: &str, modality: &str, size: [u32; 2]| {
        let [width, height] = size;
        let intrinsics = json!({ "width": width, "height": height, "fx": 500.0, "fy": 500.0, "cx": 80.0, "cy": 60.0, "distortion": "none" });
        let pose = json!({ "rotation_wxyz": [1.0, 0.0, 0.0, 0.0], "translation_m": [0.0, 0.0, 0.0] });
        json!({ "name": name, "modality": modality, "split": "train", "intrinsics": intrinsics, "world_to_camera": pose })
    };
    let mut left = camera("left", "event", [1280, 720]);
    left["events"] = json!({ "file": "events/left.npz", "count": 100, "threshold_on": 0.2, "threshold_off": 0.2,
        "lin_log_threshold": 20.0, "linear_light": true,
        "covers_ns": [5_000_000_000_i64, 5_100_000_000_i64] });
    let mut right = camera("right", "rgb", [160, 120]);
    right["frames"] = json!(frames);
    let manifest = json!({ "format": "erfgs-dataset", "version": 1, "name": "take", "span_ns": [5_000_000_000_i64, 5_075_000_000_i64],
        "provenance": { "importer": "session", "name": "take", "erfgs": "0" }, "cameras": [left, right] });
    fs::write(root.join("dataset.json"), manifest.to_string()).unwrap();

    // From its first frame to the next lap are 100 ms, and so do the events take.
    assert_laps(&played(&format!("dataset = {root:?}\ncamera = \"left\"")));

    let fields = format!(
        "kind = \"uvc\"\nserial = \"1\"\nformats = [\"grey\"]\nsizes = [[160, 120]]\nrates_hz = [40.0]\ndataset = {root:?}\ncamera = \"right\""
    );
    let mut host = device(&fields).unwrap();
    uvc::commit(&mut host, 1, 1, 250_000);
    let seen: Vec<u8> = uvc::frames(&mut host, 500).iter().map(|frame| frame.bytes[FrameTruth::PIXELS + 500]).collect();
    assert!(seen.len() >= 15, "{seen:?}");
    let first = levels.iter().position(|level| level.abs_diff(seen[0]) <= 1).unwrap();
    for (offset, level) in seen.iter().enumerate() {
        assert!(levels[(first + offset) % 4].abs_diff(*level) <= 1, "{seen:?}");
    }

    let wrong = problem(&format!("kind = \"uvc\"\nserial = \"1\"\ndataset = {root:?}\ncamera = \"middle\""));
    assert!(wrong.contains("left, right"), "{wrong}");
    let wrong = problem(&format!("kind = \"davis346\"\nserial = \"1\"\ndataset = {root:?}\ncamera = \"right\""));
    assert!(wrong.contains("no events"), "{wrong}");
}
