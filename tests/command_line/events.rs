//! Event files: what `erfgs info` and `erfgs bench decode` say of them.

use std::fs;

use erfgs_events::EventEncoding;
use erfgs_events::{
    CSV_HEADER, CdEvent, CsvEncoder, DatEncoder, DatFormat, Event, Events, Evt3Encoder, RawHeader, SensorSize, npz,
};
use serde_json::Value;

use crate::command_line::Folder;

const SIZE: SensorSize = SensorSize { width: 1280, height: 720 };

/// The digests of the little-endian bytes of each field of [`events`], as Python's `hashlib.sha3_224` gives them.
const DIGESTS: [(&str, &str); 4] = [
    ("t", "a0c7d812c8ca8551de6587f67d3fc10887ac60b2dddd435594496f95"),
    ("x", "79c8fc571e67d07b0ebac530e4bec98fec5d68768a33169b26d4ad31"),
    ("y", "69ea20231532c04bfddbc0fede0bbcf960a175767ed70381c25b3188"),
    ("on", "28d20a8cd9a3f251e8cd7460182586e3fbce5a8b487543952376ea5e"),
];

fn events() -> impl Iterator<Item = CdEvent> {
    let event = |n: u64| CdEvent {
        t_us: 1000 + n * 17,
        x: (n * 7 % 1280) as u16,
        y: (n * 3 % 720) as u16,
        on: n.is_multiple_of(3),
    };
    (0..5000).map(event)
}

/// The same events in files of several formats.
fn with_files() -> Folder {
    let folder = Folder::new();
    let mut raw = RawHeader::new(EventEncoding::Evt3, SIZE, "1", "2026-01-02 03:04:05").expect("a header").encode();
    let mut dat = DatFormat::header(SIZE, "2026-01-02 03:04:05");
    let mut csv = CSV_HEADER.to_vec();
    let mut columns = Events::new(1280, 720);
    let (mut evt3, mut items) = (Evt3Encoder::default(), DatEncoder::default());
    for event in events() {
        evt3.event(event, &mut raw).expect("encoded");
        items.event(event, &mut dat).expect("encoded");
        CsvEncoder.event(event, &mut csv);
        columns.push(Event { t_us: event.t_us as i64, x: event.x, y: event.y, on: event.on });
    }
    evt3.finish(&mut raw);
    for (name, bytes) in [("e.raw", raw), ("e.dat", dat), ("e.csv", csv)] {
        fs::write(folder.path(name), bytes).expect("written");
    }
    npz::write_events(&folder.path("e.npz"), &columns).expect("written");
    folder
}

#[test]
fn digests_are_those_of_the_fields_whatever_the_format() {
    let folder = with_files();
    for (name, format) in [("e.raw", "evt3"), ("e.dat", "dat2"), ("e.csv", "csv"), ("e.npz", "npz")] {
        let info = folder.figures(&format!("info {name} --digest"));
        assert_eq!((&info["kind"], &info["format"]), (&"events".into(), &format.into()), "{name}");
        assert_eq!((&info["events"], &info["on"], &info["off"]), (&5000.into(), &1667.into(), &3333.into()), "{name}");
        assert_eq!((&info["first_us"], &info["last_us"]), (&1000.into(), &(1000 + 4999 * 17).into()), "{name}");
        assert_eq!((&info["unordered"], &info["anomalies"]["outside"]), (&false.into(), &0.into()), "{name}");
        let digests = info["sha3_224_of_field"].as_object().expect("digests");
        assert_eq!(digests.len(), DIGESTS.len(), "{name}");
        for (field, digest) in DIGESTS {
            assert_eq!(digests[field], digest, "{field} of {name}");
        }
        let without = folder.figures(&format!("info {name}"));
        assert!(without.get("sha3_224_of_field").is_none(), "{name}: {without}");
        assert_eq!(without["rate_hz"], info["rate_hz"]);
        let text = folder.succeed(&format!("info {name} --digest"));
        assert!(text.contains("5,000 (1,667 ON, 3,333 OFF)") && text.contains(DIGESTS[0].1), "{name}: {text}");
    }
    let sized = folder.figures("info e.csv --size 640x480");
    assert!(sized["anomalies"]["outside"].as_u64() > Some(1000), "{sized}");
    let stderr = folder.fail(1, "info e.npz --size 640x480");
    assert!(stderr.contains("e.npz") && stderr.contains("1280 x 720"), "{stderr}");
}

#[test]
fn times_before_zero_are_digested_as_the_file_holds_them() {
    let folder = Folder::new();
    let mut columns = Events::new(4, 4);
    for t_us in [i64::MIN, -1, i64::MAX] {
        columns.push(Event { t_us, x: 0, y: 0, on: true });
    }
    npz::write_events(&folder.path("e.npz"), &columns).expect("written");
    let info = folder.figures("info e.npz --digest");
    assert_eq!((&info["first_us"], &info["last_us"]), (&i64::MIN.into(), &i64::MAX.into()));
    assert_eq!(info["unordered"], false);
    assert_eq!(info["sha3_224_of_field"]["t"], "28016cad15da6f0a9fbd5ef7c32e0646de2a5b8116434a9bf0a2faa1");
}

#[test]
fn decoding_is_measured_in_events_a_second() {
    let folder = with_files();
    for (name, format) in [("e.raw", "evt3"), ("e.dat", "dat2"), ("e.csv", "csv")] {
        let bench = folder.figures(&format!("bench decode {name} --runs 3"));
        assert_eq!((&bench["format"], &bench["events"]), (&format.into(), &5000.into()));
        let figure = |key: &str| bench[key].as_f64().unwrap_or_else(|| panic!("no {key} in {bench}"));
        assert!(figure("seconds") > 0.0 && figure("wall_seconds") > 0.0);
        let expected = 5000.0 / figure("seconds") * 1e-6;
        assert!((figure("Mev_per_s") / expected - 1.0).abs() < 1e-9, "{bench}");
    }
    let stderr = folder.fail(2, "bench decode e.npz");
    assert!(stderr.contains("NPZ") && stderr.contains("RAW"), "{stderr}");
}

/// With the feature, `session/tests/it/hdf5.rs` reads and writes such files.
#[cfg(not(feature = "hdf5"))]
#[test]
fn without_hdf5_it_is_said_how_to_get_it() {
    let folder = Folder::new();
    fs::write(folder.path("e.h5"), b"\x89HDF\r\n\x1a\n").expect("written");
    let stderr = folder.fail(1, "info e.h5 --digest");
    for word in ["e.h5", "--features hdf5", "libhdf5-dev"] {
        assert!(stderr.contains(word), "{stderr}");
    }
}

#[test]
fn what_has_no_events_has_no_digests() {
    let folder = Folder::with_stage("ds");
    let npz: Value = folder.figures("info ds/events/event00.npz --digest");
    assert_eq!(npz["sha3_224_of_field"]["on"].as_str().map(str::len), Some(56));
    for path in ["ds", "ds/dataset.json", "ds/points.ply"] {
        let stderr = folder.fail(2, &format!("info {path} --digest"));
        assert!(stderr.contains("--digest") && stderr.contains(path), "{stderr}");
    }
}

#[test]
fn columns_are_what_the_user_says_in_every_command_that_reads_text() {
    let folder = Folder::new();
    let lines: String = (1..50).map(|n| format!("a,{},{},{n},{}\n", n % 7, n % 5, n % 2)).collect();
    std::fs::write(folder.path("a.csv"), format!("camera,u,v,when,sign\n{lines}")).unwrap();
    for command in [
        "info a.csv",
        "export a.csv --to npz --out a.npz",
        "import a.csv",
        "replay a.csv --speed max",
        "bench decode a.csv",
    ] {
        let stderr = folder.fail(1, command);
        assert!(stderr.contains("line 1 of a.csv") && stderr.contains("--columns t_us,x,y,p"), "{command}: {stderr}");
        folder.succeed(&format!("{command} --columns -,x,y,t_ms,p"));
    }
    for read in ["info a.csv --columns -,x,y,t_ms,p", "info a.npz"] {
        let found = folder.figures(read);
        assert_eq!([&found["events"], &found["first_us"], &found["last_us"]], [49, 1000, 49_000], "{read}");
    }
    let stderr = folder.fail(1, "export a.mcap --to csv --columns x,y,t,p --out b.csv");
    assert!(stderr.contains("a session and no text"), "{stderr}");
}
