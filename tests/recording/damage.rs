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

/// A session whose chunks from number `first` on have a bit flipped.
fn flip(folder: &Path, name: &str, first: usize, stride: usize) {
    let (path, _) = files::write_session(folder);
    let mut bytes = fs::read(&path).unwrap();
    for [from, to] in records(&bytes, CHUNK).into_iter().skip(first).step_by(stride) {
        bytes[from.midpoint(to)] ^= 1;
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
    let said = fail(folder, 1, "replay some.mcap --speed max");
    assert!(said.contains("damaged places were passed over") && said.contains("checksum"), "{said}");
    let info = json(folder, &["info", "some.mcap", "--json"]);
    assert_eq!((&info["checked"], info["damage"].as_array().map(Vec::len)), (&false.into(), Some(0)));
    let text = String::from_utf8(erfgs(folder, &["info", "some.mcap"]).stdout).unwrap();
    assert!(text.contains("not checked") && text.contains("--check"), "{text}");
    let said = fail(folder, 1, "info some.mcap --check");
    assert!(said.contains("some.mcap is damaged in"), "{said}");
    let checked = erfgs(folder, &["info", "some.mcap", "--check", "--json"]);
    let checked: serde_json::Value = serde_json::from_slice(&checked.stdout).unwrap();
    assert_eq!(checked["checked"], true);
    let damage = checked["damage"].to_string();
    assert!(damage.contains("checksum") && damage.contains("of the 2600 that were recorded"), "{damage}");
    assert!(fail(folder, 1, "info some.mcap --digest").contains("damaged"));
    for format in ["raw", "csv", "png"] {
        let said = fail(folder, 1, &format!("export some.mcap --to {format} --out of-{format}"));
        assert!(said.contains("what is whole was exported") && folder.join(format!("of-{format}")).exists(), "{said}");
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
        let said = fail(folder, 1, words);
        assert!(said.contains("tiny.mcap is an MCAP file, but not a session"), "{words}: {said}");
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
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && said.contains("whole") && said.contains("no copy was written"), "{said}");
    assert!(!folder.join("copy.mcap").exists());
    let checked = json(folder, &["info", "s.mcap", "--check", "--json"]);
    assert_eq!((&checked["checked"], checked["damage"].as_array().map(Vec::len)), (&true.into(), Some(0)));
}
