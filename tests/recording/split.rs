//! Sessions in several files, through the program.

use std::{
    fs::{self, File},
    path::Path,
};

use erfgs_session::{
    Session, SessionWriter,
    container::{Entry, SessionId, Settings, Split, part_path},
};

use crate::recording::files::{self, erfgs, json};

/// The session again, in parts of half a second; how many there are.
fn in_parts(whole: &Path, first: &Path) -> u32 {
    let mut session = Session::open(whole).expect("a session");
    let summary = session.summary().clone();
    let file = File::create_new(first).expect("a file");
    let rig = summary.rig.unwrap_or_default();
    let mut writer = SessionWriter::in_parts(file, first, summary.start, &rig, Settings::default(), SessionId([3; 16]))
        .expect("begun");
    let streams: Vec<_> =
        summary.streams.iter().map(|stream| writer.add_stream(&stream.description).expect("added")).collect();
    for entry in session.messages(None) {
        let Entry::Packet { stream, packet } = entry.expect("an entry") else { continue };
        if writer.is_full(Split::Time(500_000_000), &packet) {
            let path = part_path(first, writer.part_number() + 1);
            let next = writer.next_part(File::create_new(&path).expect("a file"), &path).expect("begun");
            writer.change_to(next).expect("changed");
        }
        writer.packet(streams[stream], &packet).expect("written");
    }
    let files = writer.part_number() + 1;
    writer.finish().expect("finished");
    files
}

#[test]
fn every_command_takes_a_session_in_parts_for_the_one_that_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (whole, _) = files::write_session(folder);
    let first = folder.join("p.mcap");
    let parts = in_parts(&whole, &first);
    assert!(parts >= 5, "{parts}");
    let both = |arguments: &dyn Fn(&str) -> Vec<String>| {
        ["s", "p"].map(|name| {
            let arguments = arguments(name);
            json(folder, &arguments.iter().map(String::as_str).collect::<Vec<_>>())
        })
    };
    let words = |line: String| line.split(' ').map(str::to_owned).collect::<Vec<_>>();

    let [of_whole, of_parts] = both(&|name| words(format!("info {name}.mcap --check --digest --json")));
    assert_eq!((&of_parts["streams"], &of_parts["damage"]), (&of_whole["streams"], &serde_json::json!([])));
    assert_eq!(of_parts["files"].as_array().map(Vec::len), Some(parts as usize));
    let [of_whole, of_parts] = both(&|name| words(format!("sync {name}.mcap --json")));
    assert_eq!(of_parts["streams"], of_whole["streams"]);
    let [of_whole, of_parts] = both(&|name| words(format!("replay {name}.mcap --speed max --json")));
    assert_eq!(of_parts["streams"], of_whole["streams"]);
    for range in ["", " --from 0.8 --until 1.9"] {
        both(&|name| {
            words(format!("export {name}.mcap --to csv --stream ev0 --out {name}{}.csv{range} --json", range.len()))
        });
        let [of_whole, of_parts] =
            ["s", "p"].map(|name| fs::read(folder.join(format!("{name}{}.csv", range.len()))).expect("a file"));
        assert!(of_parts == of_whole && of_whole.len() > 100_000, "{range}");
    }

    // Cut off in the last file, and repaired.
    let last = part_path(&first, parts - 1);
    let bytes = fs::read(&last).expect("a file");
    fs::write(&last, &bytes[..bytes.len() - 200]).expect("written");
    let output = erfgs(folder, &["recover", "p.mcap"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("--in-place"), "{output:?}");
    let info = json(folder, &["info", "p.mcap", "--json"]);
    assert_eq!(info["complete"], false);
    json(folder, &["recover", "p.mcap", "--in-place", "--json"]);
    let info = json(folder, &["info", "p.mcap", "--check", "--json"]);
    assert_eq!((&info["complete"], &info["damage"]), (&true.into(), &serde_json::json!([])), "{info}");

    // One by itself; and one that lacks.
    let alone = json(folder, &["info", "p.002.mcap", "--check", "--json"]);
    assert_eq!((&alone["part"], &alone["complete"]), (&2.into(), &true.into()), "{alone}");
    fs::remove_file(part_path(&first, 2)).expect("removed");
    let output = erfgs(folder, &["info", "p.mcap"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("p.002.mcap is missing") && stderr.contains("beside the others"), "{stderr}");
}

#[test]
fn a_take_is_recorded_in_parts_and_nonsense_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("rig.toml"), "[[pattern]]\nid = \"a\"\nwidth = 160\nheight = 120\n").expect("written");
    let record = |split: &str| {
        let words =
            ["record", "rig.toml", "--out", "t.mcap", "--seconds", "2.5", "--no-preflight", "--json", "--split"];
        erfgs(folder, &[&words[..], &[split]].concat())
    };
    for (split, says) in [("5m", "5min"), ("1MB", "10MB"), ("lots", "neither a size nor a time")] {
        let refused = record(split);
        let stderr = String::from_utf8_lossy(&refused.stderr);
        assert!(refused.status.code() == Some(2) && stderr.contains(says), "{split}: {stderr}");
    }
    let done = record("1s");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let summary: serde_json::Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert!(summary["files"].as_u64() >= Some(2), "{summary}");
    let info = json(folder, &["info", "t.mcap", "--check", "--json"]);
    assert_eq!((&info["complete"], &info["bytes"]), (&true.into(), &summary["bytes"]), "{info}");
    assert_eq!(info["streams"][0]["packets"], summary["streams"][0]["written"]);
    // What is there is never overwritten.
    fs::remove_file(folder.join("t.mcap")).expect("removed");
    let refused = record("1s");
    assert!(String::from_utf8_lossy(&refused.stderr).contains("t.001.mcap' exists already"), "{refused:?}");
}
