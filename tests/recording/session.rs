use std::fs;

use erfgs_events::{Columns, Decoder, EventFile, Evt3Decoder, RawHeader, npz};

use crate::recording::files::{self, EXPOSURE_NS, PULSES, erfgs, json};

#[test]
fn a_session_is_described_cut_repaired_and_described_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (path, events) = files::write_session(folder);
    let whole = json(folder, &["info", "s.mcap", "--json"]);
    assert_eq!((&whole["kind"], &whole["complete"]), (&"session".into(), &true.into()));
    assert_eq!(whole["streams"][0]["packets"], 2600);
    assert_eq!(whole["streams"][0]["settings"]["firmware"], "3.9.0");
    assert_eq!(whole["streams"][1]["packets"], PULSES);
    let digested = json(folder, &["info", "s.mcap", "--digest", "--json"]);
    assert_eq!(digested["streams"][0]["decoded"]["events"], events.len());
    assert_eq!(digested["streams"][0]["decoded"]["sha3_224_of_field"]["t"].as_str().unwrap().len(), 56);
    let text = String::from_utf8(erfgs(folder, &["info", "s.mcap"]).stdout).unwrap();
    assert!(text.contains("ev0") && text.contains("evt3") && text.contains("1280x720"), "{text}");

    // A recorder that was killed: the file ends somewhere.
    let bytes = fs::read(&path).unwrap();
    let cut = bytes.len() * 2 / 3;
    fs::write(&path, &bytes[..cut]).unwrap();
    let damaged = json(folder, &["info", "s.mcap", "--json"]);
    assert_eq!(damaged["complete"], false);
    let packets = damaged["streams"][0]["packets"].as_u64().unwrap();
    assert!((1000..2600).contains(&packets), "{packets}");

    let recovered = json(folder, &["recover", "s.mcap", "--json"]);
    assert_eq!(recovered["was_whole"], false);
    let lost = recovered["cut_bytes"].as_u64().unwrap();
    assert!(lost < 30_000, "less than a chunk: {lost}");
    assert_eq!(fs::read(&path).unwrap(), &bytes[..cut], "the session is left alone");
    let repaired = json(folder, &["info", "s.recovered.mcap", "--json"]);
    assert_eq!(repaired["complete"], true);
    for key in ["streams", "rig", "span_seconds", "incidents"] {
        assert_eq!(repaired[key], damaged[key], "{key}");
    }
    let again = erfgs(folder, &["recover", "s.mcap"]);
    assert!(!again.status.success(), "the copy is not overwritten");
    json(folder, &["recover", "s.mcap", "--in-place", "--json"]);
    assert_eq!(fs::read(&path).unwrap(), fs::read(folder.join("s.recovered.mcap")).unwrap());
    assert_eq!(json(folder, &["recover", "s.mcap", "--in-place", "--json"])["was_whole"], true);
}

#[test]
fn event_streams_are_exported_event_for_event() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (_, events) = files::write_session(folder);

    let exported = json(folder, &["export", "s.mcap", "--to", "raw", "--json"]);
    assert_eq!(exported[0]["file"], "s.ev0.raw");
    let raw = fs::read(folder.join("s.ev0.raw")).unwrap();
    let (header, at) = RawHeader::parse(&raw);
    assert_eq!(header.get("format"), Some("EVT3;height=720;width=1280"));
    assert_eq!(header.get("serial_number"), Some("00050423"));
    assert_eq!(header.get("date"), Some("2025-06-15 15:06:40"));
    let mut columns = Columns::default();
    let mut decoder = Evt3Decoder::new(None);
    decoder.decode(&raw[at..], &mut columns);
    decoder.finish(&mut columns);
    assert!(columns.iter().eq(events.iter().copied()));
    assert_eq!(columns.edges.len() as u64, 2 * PULSES);

    let out = ["export", "s.mcap", "--to", "csv", "--stream", "ev0", "--out", "out/events.csv", "--json"];
    let exported = json(folder, &out);
    assert_eq!(exported[0]["events"], events.len());
    let csv = fs::read_to_string(folder.join("out/events.csv")).unwrap();
    let lines = csv.lines().skip(1).zip(&events);
    for (line, event) in lines {
        assert_eq!(line, format!("{},{},{},{}", event.t_us, event.x, event.y, u8::from(event.on)));
    }
    assert_eq!(csv.lines().count(), events.len() + 1);

    let exported = json(folder, &["export", "s.mcap", "--to", "aedat4", "--json"]);
    assert_eq!(exported[0]["events"], events.len());
    let mut columns = Columns::default();
    let file = EventFile::open(&folder.join("s.ev0.aedat4")).unwrap();
    file.decode(&mut columns).unwrap();
    assert!(columns.iter().eq(events.iter().copied()));

    json(folder, &["export", "s.mcap", "--to", "npz", "--out", "arrays", "--json"]);
    let npz = npz::read_events(&folder.join("arrays/ev0.npz"), None).unwrap();
    assert_eq!((npz.width, npz.height, npz.len()), (1280, 720, events.len()));
    assert!(npz.t_us.iter().zip(&events).all(|(&t_us, event)| t_us == event.t_us as i64));
}

#[test]
fn events_are_exported_as_hdf5_or_it_is_said_how_to_get_it() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (_, events) = files::write_session(folder);
    if cfg!(feature = "hdf5") {
        let exported = json(folder, &["export", "s.mcap", "--to", "h5", "--json"]);
        assert_eq!((&exported[0]["file"], &exported[0]["events"]), (&"s.ev0.h5".into(), &events.len().into()));
        let [session, file] = ["s.mcap", "s.ev0.h5"].map(|name| json(folder, &["info", name, "--digest", "--json"]));
        assert_eq!((&file["width"], &file["height"]), (&1280.into(), &720.into()));
        for field in ["t", "x", "y", "on"] {
            let of_session = &session["streams"][0]["decoded"]["sha3_224_of_field"][field];
            assert_eq!(&file["sha3_224_of_field"][field], of_session, "{field}");
        }
    } else {
        let output = erfgs(folder, &["export", "s.mcap", "--to", "h5"]);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(
            !output.status.success() && stderr.contains("--features hdf5") && stderr.contains("s.ev0.h5"),
            "{stderr}"
        );
        assert!(!folder.join("s.ev0.h5").exists());
    }
}

#[test]
fn frames_are_exported_with_their_times() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files::write_session(folder);
    json(folder, &["sync", "s.mcap", "--json"]);
    for (format, name) in [("png", "000003.png"), ("exr", "000003.exr")] {
        let exported = json(folder, &["export", "s.mcap", "--to", format, "--out", format, "--json"]);
        assert_eq!((&exported[0]["frames"], &exported[0]["damaged"]), (&PULSES.into(), &0.into()));
        assert!(folder.join(format).join("cam0").join(name).is_file());
    }
    let times = fs::read_to_string(folder.join("png/cam0/frames.csv")).unwrap();
    let row: Vec<i64> = times.lines().nth(4).unwrap().split(',').map(|field| field.parse().unwrap()).collect();
    assert_eq!(row[..2], [3, 3]);
    let mid = files::pulse_ns(3) + EXPOSURE_NS / 2;
    // The board's clock is known up to the least delay of its line: 0.6 ms here, of which 0.4 ms are the line's length.
    assert!((row[3] - mid).abs() < 400_000, "{} of {mid}", row[3]);
    let exported = json(folder, &["export", "s.mcap", "--to", "mp4", "--json"]);
    // The events as a video, and the frames.
    assert_eq!((&exported[0]["path"], &exported[1]["path"]), (&"s.ev0.mp4".into(), &"s.cam0.mp4".into()));
    assert!(fs::metadata(folder.join("s.cam0.mp4")).unwrap().len() > 500);
}

#[test]
fn clocks_are_fitted_to_the_boards_pulses_and_plotted() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files::write_session(folder);
    let sync = json(folder, &["sync", "s.mcap", "--json"]);
    for stream in sync["streams"].as_array().unwrap() {
        assert_eq!(stream["tier"], "hardware-triggered", "{stream}");
    }
    let camera = &sync["streams"][0];
    assert_eq!(camera["matched"]["matched"], PULSES);
    let epochs = camera["epochs"].as_array().unwrap();
    assert_eq!(epochs.len(), 1);
    assert!(epochs[0]["clock"]["residuals"]["p95_ns"].as_f64().unwrap() < 2000.0, "{epochs:?}");
    assert_eq!(sync["streams"][1]["exposures"]["pulse"].as_array().unwrap().len() as u64, PULSES);
    let page = fs::read_to_string(folder.join("s.sync.html")).unwrap();
    assert!(page.contains("<svg") && !page.contains("http"), "self-contained");
    assert!(folder.join("s.sync.json").is_file());
}

#[test]
fn a_session_is_replayed_whole_or_from_a_time_on() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files::write_session(folder);
    let played = json(folder, &["replay", "s.mcap", "--speed", "max", "--json"]);
    assert_eq!(played["streams"][0]["packets"], 2600);
    assert_eq!(played["streams"][2]["id"], "mcu");
    let played = json(folder, &["replay", "s.mcap", "--speed", "50", "--seek", "1.3", "--json"]);
    let packets = played["streams"][0]["packets"].as_u64().unwrap();
    assert!((1300..1302).contains(&packets), "{packets}");
    assert!(played["seconds"].as_f64().unwrap() >= 1.299 / 50.0);
}

#[test]
fn what_cannot_be_done_is_said_with_what_can() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files::write_session(folder);
    let fails = |arguments: &[&str], words: &[&str]| {
        let output = erfgs(folder, arguments);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success(), "{arguments:?}");
        assert!(words.iter().all(|word| stderr.contains(word)), "{arguments:?}: {stderr}");
    };
    fails(&["export", "s.mcap"], &["--to", "raw"]);
    fails(&["export", "s.mcap", "--to", "raw", "--stream", "cam0"], &["cam0", "grey8"]);
    fails(&["export", "s.mcap", "--to", "png", "--stream", "nobody"], &["nobody", "ev0, cam0, mcu"]);
    fs::write(folder.join("text.mcap"), "no session").unwrap();
    for command in ["info", "recover", "replay", "sync"] {
        fails(&[command, "text.mcap"], &["text.mcap is not an MCAP file"]);
        fails(&[command, "nothing.mcap"], &["nothing.mcap"]);
    }
}
