//! A rig that tests itself, through the program.

use std::{fs, path::Path};

use erfgs_hardware_mocks::{
    gige::{GigeFaults, GigeFront, GigeOptions},
    usb::scene::PatternFrames,
};
use serde_json::Value;

use crate::recording::{files::erfgs, rig::fail};

const PATTERNS: &str = "[[pattern]]\nid = \"eye\"\ndelivers = \"events\"\nrate_hz = 50.0\n\
                        [[pattern]]\nid = \"camera\"\ndelivers = \"frames\"\nwidth = 64\nheight = 64\n";

/// Runs a test: the exit code, what it prints, and what it remarks.
fn test(folder: &Path, words: &str) -> (Option<i32>, String, String) {
    let output = erfgs(folder, &words.split(' ').collect::<Vec<_>>());
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

fn verdict<'a>(report: &'a Value, device: &str, check: &str) -> &'a str {
    let checks = report["checks"].as_array().expect("checks");
    let found = checks.iter().find(|found| found["device"] == device && found["check"] == check);
    found.and_then(|found| found["verdict"].as_str()).unwrap_or_else(|| panic!("{device} {check}: {report:#}"))
}

#[test]
fn a_rig_without_a_fault_has_a_line_a_check_and_a_report() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("rig.toml"), PATTERNS).expect("written");
    let words = "devices --selftest rig.toml --seconds 1";
    let (code, text, notes) = test(folder, words);
    assert_eq!(code, Some(0), "{text}{notes}");
    for line in ["ok          eye     format ", "not-tested  rig     board-answers ", "0 faults, 0 warnings, "] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    assert!(notes.contains("opening eye") && notes.contains("recording all devices"), "{notes}");
    let names: Vec<_> = fs::read_dir(folder).expect("a folder").flatten().collect();
    let name = |entry: &fs::DirEntry| entry.file_name().into_string().expect("a name");
    let is_report = |name: &String| name.starts_with("selftest-2") && name.ends_with(".json");
    assert_eq!(names.iter().map(name).filter(is_report).count(), 1, "{names:?}");

    let (code, text, _) = test(folder, &format!("{words} --out a.json --json -q"));
    let printed: Value = serde_json::from_str(&text).expect("JSON");
    let written: Value = serde_json::from_slice(&fs::read(folder.join("a.json")).expect("a report")).expect("JSON");
    assert_eq!((code, &printed), (Some(0), &written));
    assert_eq!(verdict(&written, "camera", "frame-rate"), "ok");

    assert!(fail(folder, 2, &format!("{words} --out a.json")).contains("'a.json' exists already; --force"));
    let (code, text, _) = test(folder, &format!("{words} --out a.json --force"));
    assert_eq!(code, Some(0), "{text}");
}

#[test]
fn a_fault_has_its_name_its_remedy_and_an_exit_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let faults = GigeFaults { lost_blocks: [5, 6].into(), ..GigeFaults::default() };
    let options = GigeOptions { serial: "GEV00043".into(), faults, ..GigeOptions::default() };
    let front = GigeFront::plug(options, Box::new(PatternFrames::default())).expect("a loopback address");
    let rig = format!(
        "{PATTERNS}[[evk4]]\nid = \"left\"\nserial = \"00000007\"\n[[camera]]\nid = \"mono\"\ncamera = \"GEV00043\"\nbackend = \"gige\"\n\
         format = \"grey8\"\nwidth = 64\nheight = 48\nrate_hz = 50.0\nexposure_us = 2000\n[camera.genicam]\naddresses = [\"{}\"]\n",
        front.address()
    );
    fs::write(folder.join("rig.toml"), rig).expect("written");
    let (code, text, notes) = test(folder, "devices --selftest rig.toml --seconds 1 --out a.json");
    assert_eq!(code, Some(1), "{text}{notes}");
    assert!(notes.contains("the rig has 2 faults, listed in a.json"), "{notes}");
    let faults: Vec<&str> = text.lines().filter(|line| line.starts_with("fault ")).collect();
    let [eye, camera] = &faults[..] else { panic!("{text}") };
    assert!(eye.contains("left") && eye.contains(" opened "), "{eye}");
    assert!(camera.contains("mono") && camera.contains(" losses "), "{camera}");
    let report: Value = serde_json::from_slice(&fs::read(folder.join("a.json")).expect("a report")).expect("JSON");
    assert_eq!((verdict(&report, "left", "opened"), verdict(&report, "mono", "opened")), ("fault", "ok"));
    assert_eq!(report["devices"].as_array().expect("devices").len(), 4);
}

#[test]
fn a_test_that_cannot_be_made_says_why() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("rig.toml"), PATTERNS).expect("written");
    fs::write(folder.join("none.toml"), "[rig]\nname = \"none\"\n").expect("written");
    assert!(fail(folder, 2, "devices --selftest rig.toml --seconds 0").contains("from 0.5 to 600"));
    assert!(fail(folder, 2, "devices --selftest rig.toml --seconds nan").contains("from 0.5 to 600"));
    assert!(fail(folder, 2, "devices --selftest rig.toml --probe").contains("--probe"));
    assert!(fail(folder, 2, "devices --out a.json").contains("--selftest"));
    assert!(fail(folder, 2, "devices --selftest none.toml").contains("none.toml names no devices"));
    assert!(fail(folder, 1, "devices --selftest absent.toml").contains("absent.toml"));
    let message = fail(folder, 1, "devices --selftest rig.toml --seconds 0.5 --out rig.toml/a.json");
    assert!(message.contains("rig.toml/a.json"), "{message}");
}
