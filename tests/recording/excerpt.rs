//! Ranges cut out of recordings, and events as videos.

use std::{fs, path::Path};

use erfgs_scene::video::Video;
use erfgs_session::{Session, container::Entry};

use crate::recording::{
    files::{self, START_NS, erfgs, json},
    rig::fail,
};

/// Stream, sequence number, host time and bytes of every packet of a session.
fn packets(path: &Path) -> Vec<(usize, u64, i64, Vec<u8>)> {
    let mut session = Session::open(path).expect("a session");
    let packet = |entry| match entry {
        Ok(Entry::Packet { stream, packet }) => {
            Some((stream, packet.sequence, packet.host_ns, packet.payload.to_vec()))
        }
        Ok(_) => None,
        Err(error) => panic!("{error}"),
    };
    session.messages(None).filter_map(packet).collect()
}

#[test]
fn a_range_becomes_a_session_that_opens_checks_syncs_and_plays() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (path, _) = files::write_session(folder);
    let cut = ["export", "s.mcap", "--to", "session", "--from", "0.8", "--until", "1.9", "--out", "cut.mcap", "--json"];
    let summary = json(folder, &cut);
    assert!((summary["seconds"].as_f64().expect("seconds") - 1.1).abs() < 1e-9, "{summary}");
    let within = [START_NS + 800_000_000, START_NS + 1_900_000_000];
    let wanted: Vec<_> =
        packets(&path).into_iter().filter(|packet| (within[0]..=within[1]).contains(&packet.2)).collect();
    assert!(wanted.len() > 1100);
    assert!(packets(&folder.join("cut.mcap")) == wanted, "byte for byte, with numbers and times");

    let info = json(folder, &["info", "cut.mcap", "--check", "--digest", "--json"]);
    assert_eq!((&info["complete"], &info["damage"]), (&true.into(), &serde_json::json!([])), "{info}");
    assert_eq!(info["epoch_ns"], 1_750_000_000_800_000_000_i64);
    assert!(info["machine"]["excerpt"].as_str().expect("a note").contains("of s.mcap"), "{}", info["machine"]);
    assert_eq!(info["streams"][0]["settings"]["firmware"], "3.9.0");
    assert_eq!((&info["streams"][0]["missing"], &info["rig"]), (&0.into(), &"[rig]\n".into()));
    assert!(info["streams"][0]["first_seconds"].as_f64().expect("a time") < 0.002);
    // Times of the camera are those of the whole: its clock is tied to the board by the pulses within the range.
    let sync = json(folder, &["sync", "cut.mcap", "--json"]);
    let whole = json(folder, &["sync", "s.mcap", "--json"]);
    let tiers = |sync: &serde_json::Value| -> Vec<String> {
        sync["streams"].as_array().expect("streams").iter().map(|stream| stream["tier"].to_string()).collect()
    };
    assert_eq!(tiers(&sync), tiers(&whole), "{sync}");
    let played = json(folder, &["replay", "cut.mcap", "--speed", "max", "--json"]);
    let count: u64 =
        played["streams"].as_array().expect("streams").iter().filter_map(|of| of["packets"].as_u64()).sum();
    assert_eq!(count, wanted.len() as u64);

    // One stream alone; and what is refused.
    json(folder, &["export", "s.mcap", "--to", "session", "--stream", "cam0", "--out", "cam.mcap", "--json"]);
    assert_eq!(
        json(folder, &["info", "cam.mcap", "--check", "--json"])["streams"].as_array().expect("streams").len(),
        1
    );
    let refused = |words: &str| fail(folder, 2, words);
    assert!(refused("export s.mcap --to session --out cut.mcap").contains("never overwritten"));
    assert!(refused("export s.mcap --to session --out cut").contains("cut.mcap"));
    assert!(refused("export s.mcap --to session").contains("--out"));
    assert!(refused("export s.mcap --to csv --from 9").contains("2.6"));
    assert!(refused("export s.mcap --to csv --from 2 --until 1").contains("later"));
    assert!(refused("export s.mcap --to csv --fps 10").contains("--to mp4"));
    let nothing = fail(folder, 1, "export s.mcap --to session --stream mcu --from 0 --until 0.1 --out none.mcap");
    assert!(nothing.contains("no data from 0 s to 0.1 s") && !folder.join("none.mcap").exists(), "{nothing}");
}

#[test]
fn every_format_takes_a_range_with_the_times_of_the_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    files::write_session(folder);
    let lines = |name: &str| -> Vec<String> {
        fs::read_to_string(folder.join(name)).expect("a table").lines().skip(1).map(str::to_owned).collect()
    };
    json(folder, &["export", "s.mcap", "--to", "csv", "--out", "whole", "--json"]);
    let range = ["--from", "1.5", "--until", "2.25"];
    let export = |to: &str, out: &str| {
        json(folder, &[&["export", "s.mcap", "--to", to, "--out", out, "--json"][..], &range].concat())
    };
    export("csv", "part");
    let (whole, part) = (lines("whole/ev0.csv"), lines("part/ev0.csv"));
    // A packet of 20 events each millisecond, which came a little after it.
    assert!((14_960..=15_020).contains(&part.len()), "{}", part.len());
    let at = whole.iter().position(|line| *line == part[0]).expect("the same times");
    assert!(whole[at..at + part.len()] == part[..], "a piece of the whole");
    let events = part.len();
    assert_eq!(export("aedat4", "part")[0]["events"], events);
    assert_eq!(export("npz", "part")[0]["events"], events);
    let frames = export("png", "frames")[0]["frames"].as_u64().expect("a count");
    assert!((22..=23).contains(&frames), "three quarters of a second at 30 Hz: {frames}");
    // An event file: to the microsecond.
    let first_us: u64 = whole[0].split(',').next().and_then(|t| t.parse().ok()).expect("a time");
    let of_file = [&["export", "whole/ev0.csv", "--to", "csv", "--out", "of.csv", "--json"][..], &range].concat();
    json(folder, &of_file);
    let within = |line: &&String| {
        let t_us: u64 = line.split(',').next().and_then(|t| t.parse().ok()).expect("a time");
        (1_500_000..=2_250_000).contains(&(t_us - first_us))
    };
    assert!(lines("of.csv").iter().eq(whole.iter().filter(within)));
    let cut = [
        "export",
        "whole/ev0.csv",
        "--to",
        "session",
        "--from",
        "1.5",
        "--until",
        "2.25",
        "--out",
        "of.mcap",
        "--json",
    ];
    json(folder, &cut);
    let checked = json(folder, &["info", "of.mcap", "--check", "--digest", "--json"]);
    let decoded = checked["streams"][0]["decoded"]["events"].as_u64().expect("a count");
    assert!((14_900..=15_100).contains(&decoded), "{decoded}");
}

#[test]
fn events_become_a_video_at_any_speed() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    files::write_session(folder);
    let made = |more: &[&str]| {
        json(
            folder,
            &[
                &["export", "s.mcap", "--to", "mp4", "--stream", "ev0", "--out", "ev.mp4", "--force", "--json"][..],
                more,
            ]
            .concat(),
        )
    };
    let summary = made(&["--from", "1", "--until", "1.2", "--speed", "0.1", "--fps", "25"]);
    // A fifth of a second, ten times slower, at 25 pictures a second.
    let frames = summary[0]["frames"].as_u64().expect("a count");
    assert!((49..=51).contains(&frames), "{summary}");
    assert_eq!(summary[0]["step_us"], 4000.0);
    let events = summary[0]["events"].as_u64().expect("a count");
    assert!((3_980..=4_020).contains(&events), "{summary}");
    let mut video = Video::open(&folder.join("ev.mp4")).expect("a video");
    let mut pictures = Vec::new();
    while let Some(picture) = video.next_frame().expect("a picture") {
        pictures.push(picture);
    }
    assert_eq!(pictures.len() as u64, frames);
    assert_eq!((pictures[0].width, pictures[0].height), (1280, 720));
    // Eighty events of 4 ms, of which a third are rises: warm where they are, dark elsewhere.
    let lit = |picture: &erfgs_scene::ImageRgb8| {
        picture.data.as_chunks::<3>().0.iter().filter(|[red, _, blue]| *red > 90 || *blue > 90).count()
    };
    let counts: Vec<usize> = pictures[1..].iter().map(lit).collect();
    assert!(counts.iter().all(|&count| (20..400).contains(&count)), "{counts:?}");
    let longer = made(&["--from", "1", "--until", "1.2", "--accumulate", "100"]);
    assert_eq!(longer[0]["frames"], 6, "{longer}");
    let mut video = Video::open(&folder.join("ev.mp4")).expect("a video");
    let mut last = None;
    while let Some(picture) = video.next_frame().expect("a picture") {
        last = Some(picture);
    }
    assert!(lit(&last.expect("pictures")) > 1000, "2000 events of a tenth of a second");
    // All of a session: frames of the camera and events of the other.
    let both = json(folder, &["export", "s.mcap", "--to", "mp4", "--out", "videos", "--json"]);
    assert_eq!(both.as_array().expect("two").len(), 2, "{both}");
    assert!(folder.join("videos/ev0.mp4").exists() && folder.join("videos/cam0.mp4").exists());
    assert!(!erfgs(folder, &["export", "s.mcap", "--to", "mp4", "--speed", "0"]).status.success());
}
