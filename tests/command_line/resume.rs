use std::{
    fs,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use crate::command_line::Folder;

const TRAIN: &str = "train ds --method erf-gs --iterations 20+60 --seed 3 --deterministic --no-evaluation \
                     --set evaluation.log_every=5 --set eds.from=10 --set eds.every=10 --set density.from=5 \
                     --set density.every=10 --set density.prune_above=0";

#[test]
fn the_same_command_gives_the_same_checkpoint_and_another_seed_another() {
    let folder = Folder::with_stage("ds");
    for (run, seed) in [("a", 3), ("b", 3), ("c", 4)] {
        folder.succeed(&format!("{TRAIN} --set seed={seed} --out {run}"));
    }
    let [a, b, c] = ["a", "b", "c"].map(|run| fs::read(folder.path(run).join("checkpoint.bin")).expect("a checkpoint"));
    assert!(a == b, "two runs of one command differ");
    assert!(a != c, "the seed has no influence");
}

#[cfg(unix)]
#[test]
fn a_run_that_was_stopped_and_resumed_ends_like_one_that_was_not() {
    let folder = Folder::with_stage("ds");
    folder.succeed(&format!("{TRAIN} --out whole"));

    let mut training = folder
        .command(&format!("{TRAIN} --out stopped"))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("erfgs");
    let curve = folder.path("stopped/curve.csv");
    let deadline = Instant::now() + Duration::from_secs(300);
    // The fine stage has begun, and most of it is still to come.
    while !fs::read_to_string(&curve).is_ok_and(|text| text.contains(",fine,")) {
        assert!(training.try_wait().expect("a status").is_none(), "the run ended before it was stopped");
        assert!(Instant::now() < deadline, "the run does not get on");
        std::thread::yield_now();
    }
    let interrupt = Command::new("kill").args(["-INT", &training.id().to_string()]).status().expect("kill");
    assert!(interrupt.success());
    let output = training.wait_with_output().expect("an end");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{said}");
    let command = said.split("go on with: erfgs ").nth(1).expect("how to go on").trim();
    assert!(command.contains("--resume") && command.contains("--deterministic"), "{command}");

    folder.succeed(command);
    let read = |run: &str| fs::read(folder.path(run).join("checkpoint.bin")).expect("a checkpoint");
    assert!(read("whole") == read("stopped"), "the resumed run ended elsewhere");
    let rows = |run: &str| -> Vec<String> {
        let text = fs::read_to_string(folder.path(run).join("curve.csv")).expect("a curve");
        text.lines().map(|line| line.split(',').next().unwrap_or_default().to_owned()).collect()
    };
    assert_eq!(rows("whole"), rows("stopped"), "rows of the curve");
}

#[test]
fn a_run_is_not_overwritten_and_a_missing_or_damaged_checkpoint_is_named() {
    let folder = Folder::with_stage("ds");
    let train = "train ds --method 4dgs --iterations 2+2 --no-evaluation --out run";
    assert!(folder.fail(2, &format!("{train} --resume")).contains("train without --resume"));
    folder.succeed(train);
    assert!(folder.fail(2, train).contains("--resume"));
    let checkpoint = folder.path("run/checkpoint.bin");
    let bytes = fs::read(&checkpoint).expect("a checkpoint");
    fs::write(&checkpoint, &bytes[..bytes.len() / 2]).expect("written");
    for words in [&format!("{train} --resume"), "eval run", "export run", "render run --out pictures"] {
        let said = folder.fail(1, words);
        assert!(said.contains("checkpoint.bin"), "{words}: {said}");
    }
}
