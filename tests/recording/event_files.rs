//! Event files of other programs, imported, played and exported as they are.

use std::{fs, path::Path};

use erfgs_events::EventEncoding;
use erfgs_events::{
    Aedat4Compression, Aedat4Encoder, ApsFrame, CSV_HEADER, CdEvent, CsvEncoder, DatEncoder, DatFormat, Edge, Event,
    Events, Evt2Encoder, Evt3Encoder, ImuSample, Mark, RawHeader, SensorSize, Sink, npz,
};
use erfgs_recordings::fetched;

use crate::recording::{
    files::{erfgs, json},
    rig::fail,
};

const SIZE: SensorSize = SensorSize { width: 64, height: 48 };
const EVENTS: u64 = 6000;

/// A tenth of a second of events from `first_us` on.
fn events(first_us: u64) -> impl Iterator<Item = CdEvent> {
    (0..EVENTS).map(move |n| CdEvent {
        t_us: first_us + n * 17,
        x: (n * 7 % 64) as u16,
        y: (n * 3 % 48) as u16,
        on: n.is_multiple_of(3),
    })
}

/// Four frames, samples, marks and events, dated as DV dates them.
fn aedat4() -> Vec<u8> {
    const FIRST_US: u64 = 1_600_000_000_000_000;
    let mut encoder = Aedat4Encoder::new(SIZE, "DAVIS346_00000042", Aedat4Compression::Zstd);
    let mut bytes = Vec::new();
    for (n, event) in (0..).zip(events(FIRST_US)) {
        encoder.event(event);
        if n % 1500 == 700 {
            let pixels = (0..64 * 48).map(|pixel| (pixel + n as u16) % 256).collect();
            let (exposure_start_us, exposure_end_us) = (event.t_us, event.t_us + 4000);
            let (width, height, channels, bits) = (64, 48, 1, 8);
            encoder.mark(event.t_us, Mark::ExposureBegin);
            encoder.frame(ApsFrame { exposure_start_us, exposure_end_us, width, height, channels, pixels, bits });
            let of = n as f32;
            let (temperature, accelerometer, gyroscope) = (31.7, [0.1, of, -0.3], [of * 0.1, 2.0, 1e-7]);
            let t_us = event.t_us;
            encoder.imu(ImuSample { t_us, temperature, accelerometer, gyroscope, magnetometer: [0.0, 1.0, of] });
        }
        bytes.extend(encoder.take());
    }
    bytes.extend(encoder.finish());
    bytes
}

/// The files, by name.
fn write_files(folder: &Path) -> Vec<&'static str> {
    let header = |encoding| RawHeader::new(encoding, SIZE, "00050423", "2025-06-15 15:06:40").unwrap().encode();
    let (mut evt3, mut evt2) = (header(EventEncoding::Evt3), header(EventEncoding::Evt2));
    let mut dat = DatFormat::header(SIZE, "2025-06-15 15:06:40");
    let mut csv = CSV_HEADER.to_vec();
    let mut columns = Events::new(64, 48);
    let (mut encoder3, mut encoder2, mut items) =
        (Evt3Encoder::default(), Evt2Encoder::default(), DatEncoder::default());
    for (n, event) in (0..).zip(events(5_000_000)) {
        let edge = Edge { t_us: event.t_us, channel: 1, rising: n % 1000 == 0 };
        if n % 500 == 0 {
            encoder3.edge(edge, &mut evt3).unwrap();
            encoder2.edge(edge, &mut evt2).unwrap();
        }
        encoder3.event(event, &mut evt3).unwrap();
        encoder2.event(event, &mut evt2).unwrap();
        items.event(event, &mut dat).unwrap();
        CsvEncoder.event(event, &mut csv);
        columns.push(Event { t_us: event.t_us as i64, x: event.x, y: event.y, on: event.on });
    }
    encoder3.finish(&mut evt3);
    let mut aedat2 = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n".to_vec();
    for event in events(100) {
        let address = u32::from(179 - event.y) << 22 | u32::from(239 - event.x) << 12 | u32::from(event.on) << 11;
        aedat2.extend([address, event.t_us as u32].into_iter().flat_map(u32::to_be_bytes));
    }
    npz::write_events(&folder.join("e-npz.npz"), &columns).unwrap();
    let files = [
        ("e-evt3.raw", evt3),
        ("e-evt2.raw", evt2),
        ("e-dat.dat", dat),
        ("e-csv.csv", csv),
        ("e-aedat2.aedat", aedat2),
        ("e-aedat4.aedat4", aedat4()),
    ];
    for (name, bytes) in &files {
        fs::write(folder.join(name), bytes).unwrap();
    }
    for (name, bytes) in others() {
        fs::write(folder.join(name), bytes).unwrap();
    }
    files.iter().map(|file| file.0).chain(["e-npz.npz"]).chain(others().map(|other| other.0)).collect()
}

/// Event Stream, a structured array, and text in an archive.
fn others() -> [(&'static str, Vec<u8>); 3] {
    let mut es = b"Event Stream\x02\x00\x00\x01".to_vec();
    es.extend([64_u16, 48].into_iter().flat_map(u16::to_le_bytes));
    let header = "{'descr': [('x', '<u2'), ('y', '>i4'), (('polarity', 'p'), '|b1'), ('t', '<f8')], 'fortran_order': False, \
                  'shape': (6000,), }\n";
    let mut npy = [&b"\x93NUMPY\x01\x00"[..], &(header.len() as u16).to_le_bytes(), header.as_bytes()].concat();
    let mut text = "64 48\n".to_owned();
    let mut before_us = 0;
    for event in events(5_000_000) {
        let CdEvent { t_us, x, y, on } = event;
        es.extend(std::iter::repeat_n(0xFF, ((t_us - before_us) / 127) as usize));
        es.push(((t_us - before_us) % 127) as u8 * 2 + u8::from(on));
        es.extend([x, 47 - y].into_iter().flat_map(u16::to_le_bytes));
        before_us = t_us;
        npy.extend(x.to_le_bytes());
        npy.extend(i32::from(y).to_be_bytes());
        npy.push(on.into());
        npy.extend((t_us as f64 * 1e-6).to_le_bytes());
        text += &format!("{}.{:06} {x} {y} {}\n", t_us / 1_000_000, t_us % 1_000_000, u8::from(on));
    }
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, content) in [("calib.txt", "1 2 3"), ("../../events.txt", text.as_str())] {
        zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        std::io::Write::write_all(&mut zip, content.as_bytes()).unwrap();
    }
    [("e-es.es", es), ("e-npy.npy", npy), ("e-text.zip", zip.finish().unwrap().into_inner())]
}

/// What `info --digest` says of a file.
fn digests(folder: &Path, file: &str) -> serde_json::Value {
    let info = json(folder, &["info", file, "--digest", "--json"]);
    match &info["streams"][0]["decoded"] {
        serde_json::Value::Null => info["sha3_224_of_field"].clone(),
        decoded => decoded["sha3_224_of_field"].clone(),
    }
}

/// Imports, plays and exports a file.
fn check(folder: &Path, file: &str, encoding: &str) {
    let expected = digests(folder, file);
    assert_eq!(expected["t"].as_str().map(str::len), Some(56), "{file}");
    let imported = json(folder, &["import", file, "--out", "i.mcap", "--json"]);
    assert_eq!(imported["encoding"], encoding, "{file}: {imported}");
    assert_eq!(digests(folder, "i.mcap"), expected, "{file} imported");
    json(folder, &["info", "i.mcap", "--check", "--json"]);
    let of_session = json(folder, &["replay", "i.mcap", "--speed", "max", "--json"]);
    let of_file = json(folder, &["replay", file, "--speed", "max", "--json"]);
    assert_eq!(of_file["streams"], of_session["streams"], "{file}");
    for format in ["aedat4", "csv", "npz", "raw", "dat"] {
        let out = format!("x.{format}");
        let exported = json(folder, &["export", file, "--to", format, "--out", &out, "--json"]);
        assert_eq!(exported[0]["file"], out.as_str());
        let found = digests(folder, &out);
        // Times since 1970 are beyond those of RAW and DAT.
        let shifted = exported[0]["shift_us"].as_u64().unwrap() > 0;
        assert!(!shifted || encoding == "aedat4" && matches!(format, "raw" | "dat"), "{exported}");
        for field in if shifted { &["x", "y", "on"][..] } else { &["t", "x", "y", "on"] } {
            assert_eq!(found[field], expected[field], "{file} as {format}: {field}");
        }
        fs::remove_file(folder.join(out)).unwrap();
    }
    fs::remove_file(folder.join("i.mcap")).unwrap();
}

fn encoding_of(file: &str) -> &'static str {
    match file {
        "e-evt3.raw" => "evt3",
        "e-csv.csv" | "e-npz.npz" | "e-aedat4.aedat4" | "e-es.es" | "e-npy.npy" | "e-text.zip" => "aedat4",
        _ => "evt2",
    }
}

#[test]
fn every_event_file_is_imported_played_and_exported_without_a_change() {
    let folder = tempfile::tempdir().unwrap();
    for file in write_files(folder.path()) {
        check(folder.path(), file, encoding_of(file));
    }
}

#[cfg(feature = "hdf5")]
#[test]
fn hdf5_files_are_imported_played_and_exported_without_a_change() {
    let folder = tempfile::tempdir().unwrap();
    write_files(folder.path());
    json(folder.path(), &["export", "e-evt3.raw", "--to", "h5", "--out", "e.h5", "--json"]);
    check(folder.path(), "e.h5", "aedat4");
}

#[test]
fn packets_are_of_a_few_milliseconds_and_played_in_time() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for file in write_files(folder) {
        let packets = |words: &[&str]| {
            let played = json(folder, &[&["replay", file, "--json"], words].concat());
            (played["streams"][0]["packets"].as_u64().unwrap(), played["seconds"].as_f64().unwrap())
        };
        // 102 ms.
        let (all, seconds) = packets(&["--speed", "0.5"]);
        assert!((12..=60).contains(&all), "{file}: {all}");
        assert!(seconds > 0.19, "{file}: {seconds}");
        let (half, _) = packets(&["--seek", "0.05"]);
        assert!(half > 0 && half <= all / 2 + 2, "{file}: {half} of {all}");
        let stderr = fail(folder, 2, &format!("replay {file} --seek 7 --loop"));
        assert!(stderr.contains("--seek 7") && stderr.contains("0.10"), "{file}: {stderr}");
    }
}

#[test]
fn frames_of_a_sensor_are_exported_as_pictures_with_their_exposures() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_files(folder);
    json(folder, &["import", "e-aedat4.aedat4", "--out", "s.mcap", "--json"]);
    for (input, out) in [("e-aedat4.aedat4", "pictures"), ("s.mcap", "of-session")] {
        let exported = json(folder, &["export", input, "--to", "png", "--out", out, "--json"]);
        assert_eq!((&exported[0]["frames"], &exported[0]["damaged"]), (&4.into(), &0.into()));
    }
    let times = fs::read_to_string(folder.join("pictures/frames.csv")).unwrap();
    assert_eq!(times.lines().nth(1), Some("0,1600000000011900,1600000000015900,"));
    let picture = image::open(folder.join("pictures/000003.png")).unwrap().into_luma8();
    assert_eq!((picture.dimensions(), picture.get_pixel(5, 0).0), ((64, 48), [((5 + 5200) % 256) as u8]));
    assert_eq!(
        fs::read(folder.join("pictures/000003.png")).unwrap(),
        fs::read(folder.join("of-session/e-aedat4/000003.png")).unwrap()
    );
    json(folder, &["export", "e-aedat4.aedat4", "--to", "mp4", "--out", "v.mp4", "--json"]);
    assert!(folder.join("v.frames.csv").is_file());
    let stderr = fail(folder, 2, "export e-evt3.raw --to png --out p");
    assert!(stderr.contains("evt3") && !folder.join("p").exists(), "{stderr}");
}

#[test]
fn a_file_without_a_size_has_that_of_its_addresses_or_the_one_that_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_files(folder);
    json(folder, &["import", "e-csv.csv", "--out", "a.mcap", "--json"]);
    json(folder, &["import", "e-csv.csv", "--size", "100x80", "--out", "b.mcap", "--json"]);
    for (file, size) in [("a.mcap", [64, 46]), ("b.mcap", [100, 80])] {
        let stream = &json(folder, &["info", file, "--json"])["streams"][0];
        assert_eq!([stream["width"].as_u64().unwrap(), stream["height"].as_u64().unwrap()], size, "{file}");
    }
    json(folder, &["export", "e-csv.csv", "--to", "npz", "--out", "sized.npz", "--size", "100x80", "--json"]);
    assert_eq!(npz::read_events(&folder.join("sized.npz"), None).unwrap().width, 100);
}

#[test]
fn what_cannot_be_imported_is_said_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_files(folder);
    fs::write(folder.join("empty.raw"), "").unwrap();
    fs::write(folder.join("text.raw"), "no events").unwrap();
    let mut dat = DatFormat::header(SIZE, "");
    dat.extend([900_u32, 0, 500, 1].into_iter().flat_map(u32::to_le_bytes));
    fs::write(folder.join("back.dat"), dat).unwrap();
    let mut early = Events::new(4, 4);
    early.push(Event { t_us: -5, x: 0, y: 0, on: true });
    npz::write_events(&folder.join("early.npz"), &early).unwrap();
    for (code, words, hints) in [
        (2, "import nothing.raw", &["nothing.raw", "does not exist"][..]),
        (1, "import empty.raw", &["empty.raw", "empty"]),
        (1, "import text.raw", &["text.raw", "HDF5"]),
        (1, "replay text.raw", &["text.raw", "MCAP"]),
        (1, "import back.dat --out x.mcap", &["back.dat", "500", "sort"]),
        (1, "import early.npz --out x.mcap", &["early.npz", "-5"]),
        (2, "import e-evt3.raw --out x.raw", &["x.raw", ".mcap"]),
        (2, "export e-evt3.raw --to raw", &["e-evt3.raw", "--out"]),
        (2, "export e-evt3.raw", &["--to raw"]),
    ] {
        let stderr = fail(folder, code, words);
        assert!(hints.iter().all(|hint| stderr.contains(hint)), "erfgs {words}: {stderr}");
    }
    assert!(!folder.join("x.mcap").exists() && !folder.join("text.mcap").exists());
    json(folder, &["import", "e-evt3.raw", "--json"]);
    assert!(fail(folder, 1, "import e-evt3.raw").contains("e-evt3.mcap exists"));
    assert!(fail(folder, 2, "import e-evt3.mcap --out y.mcap").contains("already"));
}

#[test]
fn what_exists_is_overwritten_with_force_alone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_files(folder);
    for words in ["export e-evt3.raw --to csv --out x.csv", "export e-aedat4.aedat4 --to png --out p"] {
        json(folder, &[words.split(' ').collect::<Vec<_>>(), vec!["--json"]].concat());
        assert!(fail(folder, 2, words).contains("--force"), "{words}");
        json(folder, &[words.split(' ').collect::<Vec<_>>(), vec!["--force", "--json"]].concat());
    }
    // Pictures and tables that somebody else left there.
    for (there, words) in [
        ("q/000000.png", "export e-aedat4.aedat4 --to png --out q"),
        ("v.frames.csv", "export e-aedat4.aedat4 --to mp4 --out v.mp4"),
        ("e-csv.dat", "export e-csv.csv --to dat"),
    ] {
        fs::create_dir_all(folder.join("q")).unwrap();
        fs::write(folder.join(there), "mine").unwrap();
        assert!(fail(folder, 2, words).contains(there), "{words}");
        assert_eq!(fs::read_to_string(folder.join(there)).unwrap(), "mine");
    }
    let before = fs::read(folder.join("e-evt3.raw")).unwrap();
    assert!(!erfgs(folder, &["export", "e-evt3.raw", "--to", "raw", "--force"]).status.success());
    assert_eq!(fs::read(folder.join("e-evt3.raw")).unwrap(), before, "never the input");
}

#[test]
fn real_recordings_are_imported_played_and_exported_without_a_change() {
    let references: serde_json::Value =
        serde_json::from_str(include_str!("../../events/tests/it/digests.json")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (file, encoding) in
        [("evt2.raw", "evt2"), ("evt3.raw", "evt3"), ("gen4.dat", "evt2"), ("davis346.aedat4", "aedat4")]
    {
        let path = fetched(file);
        check(folder.path(), path.to_str().unwrap(), encoding);
        json(folder.path(), &["import", path.to_str().unwrap(), "--out", "r.mcap", "--json"]);
        assert_eq!(digests(folder.path(), "r.mcap"), references[file], "{file}");
        fs::remove_file(folder.path().join("r.mcap")).unwrap();
    }
    let davis = fetched("davis346.aedat4");
    let exported = json(folder.path(), &["export", davis.to_str().unwrap(), "--to", "png", "--out", "p", "--json"]);
    assert_eq!(exported[0]["frames"], 59);
    assert!((exported[0]["rate_hz"].as_f64().unwrap() - 25.0).abs() < 0.01, "{exported}");
}

#[test]
fn hot_pixels_of_real_sensors_are_found_whatever_holds_their_events() {
    let folder = tempfile::tempdir().unwrap();
    let found = |path: &str| -> Vec<(u64, u64, u64)> {
        let found = json(folder.path(), &["info", path, "--hot-pixels", "--json"]);
        let number = |pixel: &serde_json::Value, name: &str| pixel[name].as_u64().unwrap();
        let pixels = found[0]["hot_pixels"].as_array().unwrap().iter();
        pixels.map(|pixel| (number(pixel, "x"), number(pixel, "y"), number(pixel, "events"))).collect()
    };
    // Counted in the events themselves: of their 24 neighbours none has more than four.
    let hot = [(304, 66, 268), (971, 157, 235), (659, 468, 197), (803, 705, 70), (762, 197, 39)];
    for file in ["evt3.raw", "gen4.dat"] {
        assert_eq!(found(fetched(file).to_str().unwrap()), hot, "{file}");
    }
    assert_eq!(found(fetched("evt2.raw").to_str().unwrap())[..2], [(339, 451, 371), (29, 312, 168)]);
    assert_eq!(found(fetched("davis346.aedat4").to_str().unwrap()), []);
    let path = fetched("evt3.raw");
    json(folder.path(), &["import", path.to_str().unwrap(), "--out", "r.mcap", "--json"]);
    assert_eq!(found("r.mcap"), hot);
    let text = erfgs(folder.path(), &["info", "r.mcap", "--hot-pixels"]).stdout;
    assert!(String::from_utf8(text).unwrap().contains("5 hot pixels"));
    assert!(fail(folder.path(), 2, "info . --hot-pixels").contains("--hot-pixels is for sessions"));
}

#[test]
fn text_of_which_nothing_can_be_read_is_no_empty_recording() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("none.csv"), "t,x,y,on\nthis,is,no,event\nnor,is,this,one\n").unwrap();
    for words in
        ["info none.csv", "export none.csv --to npz --out x.npz", "replay none.csv", "import none.csv --out x.mcap"]
    {
        let stderr = fail(folder, 1, words);
        assert!(
            stderr.contains("nothing in none.csv can be read") && stderr.contains("2 damaged"),
            "{words}: {stderr}"
        );
    }
    assert!(!folder.join("x.npz").exists() && !folder.join("x.mcap").exists());
    // What is whole is exported, and the rest is told.
    fs::write(folder.join("some.csv"), "x,y,p,t\n3,4,1,1000\n5,6,zero,1020\n7,8,0,2000\n").unwrap();
    for words in ["export some.csv --to csv --out y.csv", "replay some.csv", "import some.csv"] {
        let stderr = fail(folder, 1, words);
        assert!(stderr.contains("1 lines or packets of it cannot be read"), "{words}: {stderr}");
    }
    assert_eq!(fs::read_to_string(folder.join("y.csv")).unwrap(), "t,x,y,on\n1000,3,4,1\n2000,7,8,0\n");
}
