use std::{
    fs,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use super::bodies::give_bodies;
use crate::command_line::{Folder, page::film_small};

const TRAIN: &str = "train ds --method erf-gs --iterations 20+60 --seed 3 --deterministic --no-evaluation \
                     --set evaluation.log_every=5 --set eds.from=10 --set eds.every=10 --set density.from=5 \
                     --set density.every=10 --set density.prune_above=0 --set camera_pose.fewest=3";

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

    let curve = folder.path("stopped/curve.csv");
    // The fine stage has begun, and most of it is still to come.
    let begun = || fs::read_to_string(&curve).is_ok_and(|text| text.contains(",fine,"));
    let training = Killed::when(&folder, &format!("{TRAIN} --out stopped"), begun);
    training.send("-INT");
    let (code, stderr) = training.end();
    assert_eq!(code, Some(130), "{stderr}");
    let command = stderr.split("go on with: erfgs ").nth(1).expect("how to go on").trim();
    assert!(command.contains("--resume") && command.contains("--deterministic"), "{command}");

    folder.succeed(command);
    let read = |run: &str| fs::read(folder.path(run).join("checkpoint.bin")).expect("a checkpoint");
    assert!(read("whole") == read("stopped"), "the resumed run ended elsewhere");
    let rows = |run: &str| -> Vec<String> {
        let text = fs::read_to_string(folder.path(run).join("curve.csv")).expect("a curve");
        // But for the time that it took, by the clock (2) and of the processor (13).
        let same = |line: &str| -> Vec<String> {
            line.split(',')
                .enumerate()
                .filter(|(at, _)| ![2, 13].contains(at))
                .map(|(_, field)| field.to_owned())
                .collect()
        };
        text.lines().map(|line| same(line).join(",")).collect()
    };
    assert_eq!(rows("whole"), rows("stopped"), "rows of the curve");
}

#[cfg(unix)]
#[test]
fn bodies_that_bend_are_followed_to_the_same_end_after_a_stop() {
    let folder = Folder::new();
    film_small(&folder);
    give_bodies(&folder.path("ds"));
    let train = "train ds --method erf-gs --motion bodies --iterations 20+100 --seed 3 --deterministic --no-evaluation \
                 --set evaluation.log_every=5";
    let refused = folder.fail(1, &format!("{train} --out none --set bodies.bend=[\"rope\"]"));
    assert!(refused.contains("`bodies.bend` names 'rope'") && refused.contains("disc"), "{refused}");
    // Who names what bends has decided: there is no trial.
    let bends = format!("{train} --set bodies.bend=[\"disc\"]");
    folder.succeed(&format!("{bends} --out whole"));
    assert!(!folder.path("whole/trial.json").exists());
    let curve = folder.path("stopped/curve.csv");
    let training = Killed::when(&folder, &format!("{bends} --out stopped"), || last_row(&curve) >= 60);
    training.send("-INT");
    let (code, stderr) = training.end();
    assert_eq!(code, Some(130), "{stderr}");
    folder.succeed(&format!("{bends} --out stopped --resume"));
    folder.succeed(&format!("{train} --set bodies.trial=0 --out rigid"));
    let read = |run: &str| fs::read(folder.path(run).join("checkpoint.bin")).expect("a checkpoint");
    assert!(read("whole") == read("stopped"), "the resumed run ended elsewhere");
    assert!(read("whole") != read("rigid"), "that it bends has no influence");
}

/// Starts a training, and kills it once it has come so far.
#[cfg(unix)]
struct Killed(std::process::Child);

#[cfg(unix)]
impl Killed {
    fn when(folder: &Folder, words: &str, far_enough: impl Fn() -> bool) -> Self {
        let training = folder.command(words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("erfgs");
        let mut this = Self(training);
        let deadline = Instant::now() + Duration::from_secs(300);
        while !far_enough() {
            assert!(this.0.try_wait().expect("a status").is_none(), "the run ended before it was stopped");
            assert!(Instant::now() < deadline, "the run does not get on");
            std::thread::yield_now();
        }
        this
    }

    fn send(&self, signal: &str) {
        // It may have ended by now.
        let _ = Command::new("kill").args([signal, &self.0.id().to_string()]).stderr(Stdio::null()).status();
    }

    fn end(self) -> (Option<i32>, String) {
        let output = self.0.wait_with_output().expect("an end");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

/// The last iteration in a curve; 0 where there is none.
#[cfg(unix)]
fn last_row(curve: &std::path::Path) -> u64 {
    let text = fs::read_to_string(curve).unwrap_or_default();
    text.lines().filter_map(|line| line.split(',').next()?.parse().ok()).max().unwrap_or(0)
}

#[cfg(unix)]
#[test]
fn a_run_that_is_killed_again_and_again_ends_like_one_that_is_not() {
    let folder = Folder::with_stage("ds");
    // A checkpoint every few iterations, by the clock.
    let train = format!("{} --set evaluation.checkpoint_minutes=0.0005", TRAIN.replace("20+60", "20+160"));
    folder.succeed(&format!("{train} --out whole"));
    let words = format!("{train} --out killed --resume");
    let curve = folder.path("killed/curve.csv");
    for far_enough in [0, 10, 60] {
        let begun = || folder.path("killed/run.json").exists() && last_row(&curve) >= far_enough;
        let training = Killed::when(&folder, &words, begun);
        training.send("-KILL");
        assert_eq!(training.end().0, None, "killed by a signal");
    }
    // As a job scheduler does it: a request to terminate, and more of them while the checkpoint is being written.
    let training = Killed::when(&folder, &words, || last_row(&curve) >= 120);
    (0..3).for_each(|_| training.send("-TERM"));
    let (code, stderr) = training.end();
    assert_eq!(code, Some(130), "{stderr}");
    assert!(stderr.contains("go on with:"), "{stderr}");

    folder.succeed(&words);
    let read = |run: &str, file: &str| fs::read(folder.path(run).join(file)).expect("a file of the run");
    for file in ["checkpoint.bin", "point_cloud.ply", "config.toml"] {
        assert!(read("whole", file) == read("killed", file), "{file} of the killed run is another");
    }
    let info = |run: &str| serde_json::from_slice::<serde_json::Value>(&read(run, "run.json")).expect("JSON");
    assert_eq!((&info("killed")["finished"], &info("whole")["finished"]), (&true.into(), &true.into()));
    assert_eq!(info("killed")["identity"], info("whole")["identity"]);
    assert_eq!(info("killed")["identity"].as_str().map(str::len), Some(64));

    // Once more: nothing is left to be done, and nothing is.
    let written =
        || fs::metadata(folder.path("killed/checkpoint.bin")).and_then(|file| file.modified()).expect("a time");
    let before = written();
    let figures = folder.figures(&words);
    assert_eq!((figures["finished"].as_bool(), figures["iterations"].as_u64()), (Some(true), Some(180)), "{figures}");
    assert_eq!(written(), before, "the checkpoint was written again");
}

#[test]
fn a_run_goes_on_with_its_own_data_and_settings_alone() {
    let folder = Folder::with_stage("ds");
    let train = "train ds --method 4dgs --iterations 2+2 --no-evaluation --out run --resume";
    folder.succeed(train);
    let stderr = folder.fail(2, &format!("{train} --set density.every=7 --seed 9"));
    assert!(stderr.contains("density.every is 7 here, and") && stderr.contains("seed is 9 here, and 0"), "{stderr}");
    assert!(stderr.contains("--change"), "{stderr}");
    let stderr = folder.fail(2, "train ds --preset paper --iterations 2+2 --out run --resume");
    assert!(stderr.contains("preset is \"paper\" here, and \"default\" in the run"), "{stderr}");
    let stderr = folder.fail(2, &format!("{train} --minutes 3"));
    assert!(stderr.contains("the time of training is 3 minutes here, and not limited in the run"), "{stderr}");
    // Settings that are not given are those of the run.
    folder.succeed("train ds --no-evaluation --out run --resume");
    let more = folder.figures("train ds --iterations 2+4 --no-evaluation --out run --resume --change");
    assert_eq!(more["iterations"].as_u64(), Some(6), "{more}");

    super::copy(&folder.path("ds"), &folder.path("other"));
    let manifest = folder.path("other/dataset.json");
    let text = fs::read_to_string(&manifest).expect("a manifest");
    let mut value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    value["name"] = "another take".into();
    fs::write(&manifest, value.to_string()).expect("written");
    let stderr = folder.fail(2, "train other --no-evaluation --out run --resume");
    assert!(stderr.contains("another dataset") && stderr.contains("SHA-256"), "{stderr}");
    // Wherever the same data lie, it is the same run.
    fs::rename(folder.path("ds"), folder.path("moved")).expect("moved");
    folder.succeed("train moved --no-evaluation --out run --resume");
}

#[test]
fn a_run_is_not_overwritten_and_a_damaged_checkpoint_is_named() {
    let folder = Folder::with_stage("ds");
    let train = "train ds --method 4dgs --iterations 2+2 --no-evaluation --out run";
    folder.succeed(train);
    assert!(folder.fail(2, train).contains("--resume"));
    let checkpoint = folder.path("run/checkpoint.bin");
    let bytes = fs::read(&checkpoint).expect("a checkpoint");
    fs::write(&checkpoint, &bytes[..bytes.len() / 2]).expect("written");
    for words in [&format!("{train} --resume"), "eval run", "export run", "render run --out pictures"] {
        let stderr = folder.fail(1, words);
        assert!(stderr.contains("checkpoint.bin"), "{words}: {stderr}");
    }
}

#[test]
fn a_checkpoint_with_a_number_that_is_none_is_refused_by_all_that_open_a_run() {
    let folder = Folder::with_stage("ds");
    let train = "train ds --method 4dgs --iterations 2+2 --no-evaluation --out run";
    folder.succeed(train);
    let file = folder.path("run/checkpoint.bin");
    let mut checkpoint = erfgs_train::checkpoint::Checkpoint::load(&file).expect("a checkpoint");
    checkpoint.population.gaussians.core[14] = f32::NAN;
    checkpoint.save(&file).expect("saved");
    let resume = format!("{train} --resume");
    for words in
        [resume.as_str(), "eval run", "export run", "export run --to e4d --out a.e4d", "render run --out pictures"]
    {
        let stderr = folder.fail(1, words);
        let named = stderr.contains("checkpoint.bin") && stderr.contains("number 14 of its 'core' is NaN");
        assert!(named && stderr.contains("move it away"), "{words}: {stderr}");
    }
    assert!(!folder.path("pictures").exists() && !folder.path("a.e4d").exists());
}

#[test]
fn a_checkpoint_of_other_event_cameras_is_refused() {
    let folder = Folder::with_stage("ds");
    folder.succeed("train ds --iterations 2+4 --no-evaluation --out run");
    let file = folder.path("run").join("checkpoint.bin");
    let mut checkpoint = erfgs_train::checkpoint::Checkpoint::load(&file).expect("a checkpoint");
    let last = checkpoint.levels.pop().expect("levels of an event camera");
    checkpoint.levels.push(last[..last.len() - 2].to_vec());
    checkpoint.save(&file).expect("saved");
    let stderr = folder.fail(1, "train ds --iterations 2+8 --resume --change --no-evaluation --out run");
    assert!(stderr.contains("levels of 3455 event pixels, but the dataset has 3456"), "{stderr}");
}

/// What makes datasets before it trains has nothing to save until then, and a film of the stage takes minutes.
#[cfg(unix)]
#[test]
fn a_measurement_that_still_films_ends_at_once() {
    let folder = Folder::new();
    let words = "bench acts --acts throw --methods 4dgs --out acts";
    let filming = Killed::when(&folder, words, || folder.path("acts/datasets/throw-1/images").exists());
    filming.send("-TERM");
    let (code, stderr) = filming.end();
    assert_eq!(code, Some(130), "{stderr}");
    assert!(!folder.path("acts/datasets/throw-1/dataset.json").exists(), "it was filmed to its end");
}
