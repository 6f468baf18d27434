//! Recordings for the tools of others, by the command line. What those tools read of them: `session/bridge/tests/it`.

use std::{path::Path, process::Command};

use serde_json::{Value, json};

fn erfgs(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_erfgs"));
    let output = command.current_dir(folder).args(arguments).arg("--json").output().expect("erfgs starts");
    let stderr = String::from_utf8(output.stderr).unwrap();
    (output.status.code(), stderr, serde_json::from_slice(&output.stdout).unwrap_or_default())
}

#[test]
fn an_event_file_becomes_pictures_and_a_bag_that_holds_its_events() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rows = (0..3000).map(|n| format!("{},{},{},{}\n", 1000 + n * 70, n % 64, n / 64 % 48, n % 2));
    let text = format!("t,x,y,on\n{}", rows.collect::<String>());
    std::fs::write(folder.join("e.csv"), text).unwrap();
    let (code, stderr, written) = erfgs(folder, &["export", "e.csv", "--to", "foxglove", "--fps", "100"]);
    assert_eq!(code, Some(0), "{stderr}");
    let [topic] = &written["topics"].as_array().unwrap()[..] else { panic!("{written}") };
    assert_eq!((&topic["schema"], &written["path"]), (&json!("foxglove.CompressedImage"), &json!("e.foxglove.mcap")));
    // 210 ms of events.
    assert_eq!(topic["messages"], 21);
    let (code, stderr, _) = erfgs(folder, &["export", "e.csv", "--to", "rosbag2", "--out", "bag"]);
    assert_eq!(code, Some(0), "{stderr}");
    let (code, stderr, info) = erfgs(folder, &["export", "e.csv", "--to", "csv", "--out", "back.csv"]);
    assert_eq!((code, &info[0]["events"]), (Some(0), &json!(3000)), "{stderr}");
    let of_file = std::fs::read(folder.join("back.csv")).unwrap();
    let (code, stderr, info) = erfgs(folder, &["info", "bag"]);
    assert_eq!((code, info["streams"].as_array().map(Vec::len)), (Some(0), Some(1)), "{stderr}");
    let id = info["streams"][0]["id"].as_str().unwrap();
    let (code, stderr, _) = erfgs(folder, &["export", "bag", "--to", "csv", "--stream", id, "--out", "bag.csv"]);
    assert_eq!(code, Some(0), "{stderr}");
    assert!(std::fs::read(folder.join("bag.csv")).unwrap() == of_file, "the bag has the same events");
    std::fs::write(folder.join("late.csv"), "t,x,y,on\n20000000,2,3,1\n20000090,2,3,0\n").unwrap();
    let (code, stderr, written) = erfgs(folder, &["export", "late.csv", "--to", "rosbag2"]);
    let note = written["notes"][0].as_str().unwrap();
    assert!(code == Some(0) && stderr.contains(note), "{stderr}");
    assert!(note.contains("'late'") && note.contains("16777216 us less"), "{note}");
}

#[test]
fn options_that_say_nothing_of_a_tool_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("e.csv"), "t,x,y,on\n1,2,3,1\n90,2,3,0\n").unwrap();
    std::fs::create_dir(folder.join("full")).unwrap();
    std::fs::write(folder.join("full/mine"), "x").unwrap();
    for (arguments, expected) in [
        (&["--to", "csv", "--rig", "rig.json"][..], "--rig is for other tools"),
        (&["--to", "rosbag2", "--jpeg", "90"], "--jpeg is for --to foxglove"),
        (&["--to", "foxglove", "--speed", "0.1"], "--speed is for videos of events"),
        (&["--to", "rosbag2", "--fps", "10"], "--fps is for pictures of events"),
        (&["--to", "rosbag2", "--force"], "must be new or empty"),
        (&["--to", "foxglove", "--out", "e.png"], "write --out e.mcap"),
    ] {
        let (code, stderr, _) = erfgs(folder, &[&["export", "e.csv"], arguments].concat());
        assert_eq!(code, Some(2), "{arguments:?}: {stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
    }
    for (arguments, expected) in [
        (&["--to", "rosbag2", "--out", "full"][..], "full exists already"),
        (&["--to", "foxglove", "--rig", "none.json"], "none.json"),
    ] {
        let (code, stderr, _) = erfgs(folder, &[&["export", "e.csv"], arguments].concat());
        assert_eq!(code, Some(1), "{arguments:?}: {stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
    }
    let left: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
}
