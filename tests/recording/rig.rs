//! A rig without a camera, recorded.

use std::{
    fs,
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Command, Stdio},
    thread,
    time::Duration,
};

use tempfile::TempDir;

use crate::recording::files::{erfgs, json};

const RIG: &str = r#"
[rig]
name = "patterns"

[record]
flush_ms = 50

[[pattern]]
id = "eye"
delivers = "events"
rate_hz = 50.0
events_per_packet = 500

[[pattern]]
id = "camera"
delivers = "frames"
width = 160
height = 120
"#;

/// A folder with a second of two patterns in `take.mcap`, and what `erfgs record` said of it.
pub fn recorded() -> (TempDir, serde_json::Value) {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("rig.toml"), RIG).expect("written");
    let summary = figures(folder.path(), "record rig.toml --out take.mcap --seconds 1 --no-preflight");
    (folder, summary)
}

/// What a command that must succeed prints under `--json`.
fn figures(folder: &Path, words: &str) -> serde_json::Value {
    json(folder, &words.split(' ').chain(["--json"]).collect::<Vec<_>>())
}

/// Runs a command that must fail with the exit code `code`, without a panic, and gives its stderr.
pub fn fail(folder: &Path, code: i32, words: &str) -> String {
    let output = erfgs(folder, &words.split(' ').collect::<Vec<_>>());
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "erfgs {words}\n{stderr}");
    assert!(!stderr.contains("panicked") && !stderr.contains("RUST_BACKTRACE"), "erfgs {words}\n{stderr}");
    stderr
}

#[test]
fn a_rig_is_recorded_told_of_played_fitted_and_exported() {
    let (kept, summary) = recorded();
    let folder = kept.path();
    let written = |id: &str| {
        let streams = summary["streams"].as_array().expect("streams");
        streams.iter().find(|stream| stream["id"] == id).and_then(|stream| stream["written"].as_u64()).expect("a count")
    };
    assert!(written("eye") > 5 && written("camera") > 3, "{summary}");

    let info = figures(folder, "info take.mcap");
    assert!(info.to_string().contains("\"camera\""), "{info}");

    let played = figures(folder, "replay take.mcap --speed max");
    let passed = |id: &str| {
        let streams = played["streams"].as_array().expect("streams");
        streams.iter().find(|stream| stream["id"] == id).and_then(|stream| stream["packets"].as_u64())
    };
    assert_eq!((passed("eye"), passed("camera")), (Some(written("eye")), Some(written("camera"))), "{played}");

    let sync = figures(folder, "sync take.mcap --flash");
    assert_eq!(sync["streams"][0]["tier"], "free-running", "{sync}");
    assert!(fs::read_to_string(folder.join("take.sync.html")).expect("a page").contains("<svg"));

    figures(folder, "export take.mcap --to csv --stream eye --out eye.csv");
    let lines = fs::read_to_string(folder.join("eye.csv")).expect("a table").lines().count() as u64;
    // Fourteen steps of the wheel with ten edges of three events each, for the 500 that were asked for.
    assert_eq!(lines, written("eye") * 420 + 1);
    figures(folder, "export take.mcap --to png --out pictures");
    let times = walk(&folder.join("pictures"), "frames.csv");
    assert_eq!(times.lines().count() as u64, written("camera") + 1);

    assert!(fail(folder, 2, "record rig.toml --out take.mcap").contains("never overwritten"));
}

/// The text of the only file of this name below a folder.
fn walk(folder: &Path, name: &str) -> String {
    let found: Vec<_> = fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .map(|path| if path.is_dir() { path.join(name) } else { path })
        .filter(|path| path.ends_with(name) && path.exists())
        .collect();
    assert_eq!(found.len(), 1, "{found:?}");
    fs::read_to_string(&found[0]).expect("a text")
}

#[test]
fn a_recording_that_was_cut_off_is_recovered() {
    let (kept, _) = recorded();
    let folder = kept.path();
    let whole = fs::read(folder.join("take.mcap")).expect("a session");
    fs::write(folder.join("cut.mcap"), &whole[..whole.len() * 2 / 3]).expect("written");
    let info = figures(folder, "info cut.mcap");
    assert_eq!(info["complete"], false, "{info}");
    figures(folder, "recover cut.mcap --out again.mcap");
    let info = figures(folder, "info again.mcap");
    assert_eq!(info["complete"], true, "{info}");
    figures(folder, "replay again.mcap --speed max");
    fs::write(folder.join("none.mcap"), "no session").expect("written");
    assert!(fail(folder, 1, "recover none.mcap").contains("none.mcap"));
}

/// A file that may grow no further stands for a disk that is full. No time is given: the recording goes on until it is, and chunks of
/// 1 MiB have room before, however fast the machine writes.
#[cfg(target_os = "linux")]
#[test]
fn of_a_recording_that_the_disk_has_no_room_for_the_table_counts_what_the_file_holds() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let rig = RIG.replace("flush_ms = 50", "flush_ms = 50\nchunk_mib = 1").replace("= 500\n", "= 20000\n");
    fs::write(folder.join("rig.toml"), rig).expect("written");
    let script = format!(
        "trap '' XFSZ; ulimit -f 3000; exec '{}' record rig.toml --out take.mcap --no-preflight --json -q",
        env!("CARGO_BIN_EXE_erfgs")
    );
    let output =
        std::process::Command::new("bash").args(["-c", &script]).current_dir(folder).output().expect("it runs");
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    let table: serde_json::Value = serde_json::from_slice(&output.stdout).expect("a table");
    let session = json(folder, &["info", "take.mcap", "--json"]);
    assert_eq!(session["complete"], false, "{session}");
    let mut packets = 0;
    for (row, there) in std::iter::zip(table["streams"].as_array().unwrap(), session["streams"].as_array().unwrap()) {
        assert_eq!((&row["id"], &row["written"]), (&there["id"], &there["packets"]));
        assert_eq!(row["written_bytes"], there["bytes"]);
        packets += there["packets"].as_u64().unwrap();
    }
    assert_eq!(table["bytes"], session["bytes"]);
    assert!(packets > 0, "{session}");
}

#[test]
fn enter_keeps_the_seconds_before() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("rig.toml"), RIG).expect("written");
    let mut recorder = Command::new(env!("CARGO_BIN_EXE_erfgs"))
        .current_dir(folder.path())
        .args("record rig.toml --out takes --before 0.6 --after 0.4 --on rate:1000 --no-preflight".split(' '))
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("erfgs starts");
    let mut lines = BufReader::new(recorder.stderr.take().expect("stderr")).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.contains("Enter keeps them")));
    thread::sleep(Duration::from_millis(1500));
    recorder.stdin.as_mut().expect("stdin").write_all(b"\n").expect("told");
    let line = lines.find(|line| line.contains("recorded ") && line.contains("into")).expect("the end of it");
    assert!(line.contains("after the trigger"), "{line}");
    let _ = recorder.kill();
    let _ = recorder.wait();
    let takes: Vec<_> = fs::read_dir(folder.path().join("takes")).expect("a folder").flatten().collect();
    assert_eq!(takes.len(), 1, "{takes:?}");
    let name = takes[0].file_name().into_string().expect("a name");
    let info = figures(&folder.path().join("takes"), &format!("info {name} --check"));
    let seconds = info["span_seconds"].as_f64().expect("a time");
    assert!((0.8..3.0).contains(&seconds) && info["complete"] == true, "{info}");
    assert!(
        fail(folder.path(), 2, "record rig.toml --out new --before 1 --on edge:camera --no-preflight")
            .contains("camera")
    );
    assert!(fail(folder.path(), 2, "record rig.toml --out new --on edge").contains("--before"));
}
