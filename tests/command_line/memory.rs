//! Trainings whose frames and events do not fit into memory.

use std::fs;

use crate::command_line::Folder;

const TRAIN: &str = "train ds --method erf-gs --iterations 20+20 --seed 3 --deterministic --no-evaluation --set eds.from=10 \
                     --set eds.every=10 --set density.from=5 --set density.every=10 --set density.prune_above=0";

#[test]
fn frames_and_events_that_are_read_again_teach_the_same() {
    let folder = Folder::with_stage("ds");
    let output = folder.run(&format!("{TRAIN} --out kept --memory 1"));
    assert!(output.status.success() && !String::from_utf8_lossy(&output.stderr).contains("--memory"), "{output:?}");
    // No frame, and some; there are some thousand events.
    for (run, memory) in [("none", "0"), ("some", "4e-5")] {
        let output = folder.run(&format!("{TRAIN} --out {run} --memory {memory}"));
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && text.contains("of them are kept in memory (--memory)"), "{text}");
        assert!(text.contains("events are kept in temporary files"), "{text}");
        let left: Vec<_> =
            fs::read_dir(folder.path(run)).expect("a run").flatten().map(|entry| entry.file_name()).collect();
        assert!(left.iter().all(|name| !name.to_string_lossy().starts_with(".tmp")), "{left:?}");
    }
    // The device has room for nothing, for some and for all; what it has no room for is not uploaded before it is looked at.
    for (run, memory) in [("none", "0"), ("some", "6e-5"), ("all", "1")] {
        let output = folder.run(&format!("{TRAIN} --out {run}-there --device-memory {memory}"));
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && text.contains("(--device-memory)") == (run != "all"), "{text}");
    }
    folder.succeed(&format!("{TRAIN} --out none-anywhere --memory 0 --device-memory 3e-5"));
    let [kept, none, some] =
        ["kept", "none", "some"].map(|run| fs::read(folder.path(run).join("checkpoint.bin")).expect("a checkpoint"));
    assert!(kept == none && kept == some, "it matters which frames are kept");
    for run in ["none-there", "some-there", "all-there", "none-anywhere"] {
        assert!(kept == fs::read(folder.path(run).join("checkpoint.bin")).expect("a checkpoint"), "{run}");
    }
}

#[test]
fn a_frame_that_cannot_be_read_any_more_costs_nothing_that_was_trained() {
    let folder = Folder::with_stage("ds");
    // Where something may move all frames are looked at before they teach.
    let train = format!("{TRAIN} --motion still --memory 0");
    folder.succeed(&format!("{train} --out whole"));
    let images = folder.path("ds/images");
    let camera = fs::read_dir(&images).expect("cameras").flatten().map(|entry| entry.path()).min().expect("a camera");
    let frame = fs::read_dir(camera).expect("frames").flatten().map(|entry| entry.path()).max().expect("a frame");
    let whole = fs::read(&frame).expect("a frame");
    fs::write(&frame, &whole[..whole.len() / 2]).expect("written");

    let output = folder.run(&format!("{train} --out cut"));
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains(&*frame.file_name().expect("a name").to_string_lossy()), "{text}");
    let command = text.split("can be read again, continue with: erfgs ").nth(1).and_then(|rest| rest.lines().next());
    let command = command.unwrap_or_else(|| panic!("how to go on: {text}"));
    assert!(folder.path("cut/checkpoint.bin").is_file(), "{text}");

    fs::write(&frame, &whole).expect("written");
    folder.succeed(command);
    let [whole, cut] =
        ["whole", "cut"].map(|run| fs::read(folder.path(run).join("checkpoint.bin")).expect("a checkpoint"));
    assert!(whole == cut, "the run that was gone on with ended elsewhere");
}
