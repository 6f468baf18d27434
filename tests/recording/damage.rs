//! Sessions that are damaged, empty, or none: what each command says, and with which exit code.

use std::{fs, path::Path};

use crate::recording::{
    files::{self, erfgs, json},
    rig::fail,
};

/// Where a record of this kind starts, in the order of the file: opcode, length, body.
fn records(bytes: &[u8], opcode: u8) -> Vec<[usize; 2]> {
    let (mut at, mut found) = (8, Vec::new());
    while at + 9 <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        let end = at.saturating_add(9).saturating_add(length);
        if end > bytes.len() {
            break;
        }
        if bytes[at] == opcode {
            found.push([at, end]);
        }
        at = end;
    }
    found
}

const CHUNK: u8 = 6;

/// A session whose chunks from number `first` on have a byte damaged.
fn flip(folder: &Path, name: &str, first: usize, stride: usize) {
    let (path, _) = files::write_session(folder);
    let mut bytes = fs::read(&path).unwrap();
    for [from, to] in records(&bytes, CHUNK).into_iter().skip(first).step_by(stride) {
        // Several bits: a single one would be put right.
        bytes[from.midpoint(to)] ^= 0x55;
    }
    fs::rename(path, folder.join(name)).unwrap();
    fs::write(folder.join(name), bytes).unwrap();
}

#[test]
fn lost_packets_end_a_playback_with_code_1_and_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // The first three chunks declare the streams.
    flip(folder, "some.mcap", 3, 2);
    let stderr = fail(folder, 1, "replay some.mcap --speed max");
    assert!(stderr.contains("damaged places were skipped") && stderr.contains("checksum"), "{stderr}");
    let info = json(folder, &["info", "some.mcap", "--json"]);
    assert_eq!((&info["checked"], info["damage"].as_array().map(Vec::len)), (&false.into(), Some(0)));
    let text = String::from_utf8(erfgs(folder, &["info", "some.mcap"]).stdout).unwrap();
    assert!(text.contains("not checked") && text.contains("--check"), "{text}");
    let stderr = fail(folder, 1, "info some.mcap --check");
    assert!(stderr.contains("some.mcap is damaged in"), "{stderr}");
    let checked = erfgs(folder, &["info", "some.mcap", "--check", "--json"]);
    let checked: serde_json::Value = serde_json::from_slice(&checked.stdout).unwrap();
    assert_eq!(checked["checked"], true);
    let damage = checked["damage"].to_string();
    assert!(damage.contains("checksum") && damage.contains("of the 2600 that were recorded"), "{damage}");
    assert!(fail(folder, 1, "info some.mcap --digest").contains("damaged"));
    for format in ["raw", "csv", "png"] {
        let stderr = fail(folder, 1, &format!("export some.mcap --to {format} --out of-{format}"));
        assert!(
            stderr.contains("the intact part was exported") && folder.join(format!("of-{format}")).exists(),
            "{stderr}"
        );
    }
    let recovered = json(folder, &["recover", "some.mcap", "--json"]);
    assert!(recovered["damaged"].as_array().unwrap().len() > 5, "{recovered}");
    json(folder, &["info", "some.recovered.mcap", "--check", "--json"]);
    json(folder, &["replay", "some.recovered.mcap", "--speed", "max", "--json"]);
}

#[test]
fn a_session_of_which_nothing_is_whole_is_not_repaired_into_an_empty_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    flip(folder, "all.mcap", 0, 1);
    assert!(fail(folder, 1, "recover all.mcap").contains("nothing can be saved from all.mcap"));
    assert!(fail(folder, 1, "recover all.mcap --in-place").contains("all.mcap"));
    assert!(!folder.join("all.recovered.mcap").exists());
    fail(folder, 1, "replay all.mcap --speed max");
    fail(folder, 1, "info all.mcap --check");
}

#[test]
fn what_is_no_session_or_empty_is_said_and_not_repaired() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (path, _) = files::write_session(folder);
    let bytes = fs::read(path).unwrap();
    fs::write(folder.join("tiny.mcap"), &bytes[..40]).unwrap();
    fs::write(folder.join("empty.mcap"), "").unwrap();
    for words in ["recover tiny.mcap", "recover tiny.mcap --in-place", "info tiny.mcap", "replay tiny.mcap"] {
        let stderr = fail(folder, 1, words);
        assert!(stderr.contains("tiny.mcap is an MCAP file, but not a session"), "{words}: {stderr}");
    }
    assert!(!folder.join("tiny.recovered.mcap").exists());
    assert_eq!(fs::read(folder.join("tiny.mcap")).unwrap(), &bytes[..40], "left alone");
    for command in ["recover", "info", "replay", "sync"] {
        assert!(fail(folder, 1, &format!("{command} empty.mcap")).contains("empty.mcap is empty"), "{command}");
    }
}

#[test]
fn of_a_whole_session_it_is_said_that_no_copy_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files::write_session(folder);
    let output = erfgs(folder, &["recover", "s.mcap", "--out", "copy.mcap"]);
    let stdout = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && stdout.contains("whole") && stdout.contains("no copy was written"), "{stdout}");
    assert!(!folder.join("copy.mcap").exists());
    let checked = json(folder, &["info", "s.mcap", "--check", "--json"]);
    assert_eq!((&checked["checked"], checked["damage"].as_array().map(Vec::len)), (&true.into(), Some(0)));
}

#[test]
fn a_session_that_was_cut_is_exported_and_played_as_far_as_it_goes_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (path, _) = files::write_session(folder);
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
    for (words, done) in [
        ("export s.mcap --to csv --out csv", "exported"),
        ("export s.mcap --to raw --out raw", "exported"),
        ("export s.mcap --to png --out png", "exported"),
        ("replay s.mcap --speed max", "played"),
    ] {
        let stderr = fail(folder, 1, words);
        assert!(
            stderr.contains(&format!("the intact part was {done}")) && stderr.contains("was not ended"),
            "{words}: {stderr}"
        );
    }
    assert!(fs::read_to_string(folder.join("csv/ev0.csv")).unwrap().lines().count() > 1000);
    assert!(
        fs::metadata(folder.join("raw/ev0.raw")).unwrap().len() > 10_000
            && folder.join("png/cam0/000000.png").is_file()
    );
    json(folder, &["recover", "s.mcap", "--json"]);
    json(folder, &["export", "s.recovered.mcap", "--to", "raw", "--out", "whole", "--json"]);
}

#[test]
fn a_chunk_that_lacks_or_comes_twice_is_found_by_a_check_and_exported_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (path, events) = files::write_session(folder);
    let bytes = fs::read(path).unwrap();
    let chunks = records(&bytes, CHUNK);
    let [from, to] = chunks[chunks.len() / 2];
    fs::write(folder.join("lacks.mcap"), [&bytes[..from], &bytes[to..]].concat()).unwrap();
    fs::write(folder.join("twice.mcap"), [&bytes[..to], &bytes[from..]].concat()).unwrap();
    for (file, hint) in [("lacks.mcap", "that were recorded"), ("twice.mcap", "repeats that of byte")] {
        let stderr = fail(folder, 1, &format!("info {file} --check"));
        assert!(stderr.contains("is damaged in"), "{stderr}");
        let stderr = fail(folder, 1, &format!("export {file} --to csv --out {file}.csv --stream ev0"));
        assert!(stderr.contains(hint), "{stderr}");
        json(folder, &["recover", file, "--out", &format!("whole-{file}"), "--json"]);
        json(folder, &["info", &format!("whole-{file}"), "--check", "--json"]);
    }
    let lines = |file: &str| fs::read_to_string(folder.join(file)).unwrap().lines().count() - 1;
    assert_eq!(lines("twice.mcap.csv"), events.len());
    assert!(lines("lacks.mcap.csv") < events.len());
}

#[test]
fn a_bit_that_flipped_is_put_right() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (path, _) = files::write_session(folder);
    let before = json(folder, &["info", "s.mcap", "--digest", "--json"]);
    let mut bytes = fs::read(&path).unwrap();
    let chunks = records(&bytes, CHUNK);
    let [from, to] = chunks[chunks.len() / 2];
    bytes[from.midpoint(to)] ^= 1;
    fs::write(&path, bytes).unwrap();
    assert!(fail(folder, 1, "info s.mcap --check").contains("is damaged in 1 places"));
    let recovered = json(folder, &["recover", "s.mcap", "--in-place", "--json"]);
    assert_eq!(recovered["mended"].as_array().map(Vec::len), Some(1), "{recovered}");
    assert_eq!(recovered["damaged"].as_array().map(Vec::len), Some(0), "{recovered}");
    let after = json(folder, &["info", "s.mcap", "--digest", "--json"]);
    assert_eq!(after["streams"], before["streams"]);
    json(folder, &["info", "s.mcap", "--check", "--json"]);
}
