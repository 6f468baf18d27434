//! The program as its user meets it: whole pipelines, resuming, and what it says about bad input.

mod blank;
mod bodies;
pub mod browser;
mod budget;
mod calibrate;
mod clocks;
mod colours;
mod device_memory;
mod events;
mod find_bodies;
mod inputs;
mod memory;
mod page;
mod pipeline;
mod poses;
mod precision;
mod resume;
mod shell;
mod simulate;
#[cfg(target_os = "linux")]
mod slurm;
mod stability;
mod still;
mod sweep;
mod takes;
mod traffic;
mod variants;
mod view;
mod watched;
mod without_dataset;

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::LazyLock,
};

use erfgs_stage::{EventOptions, FilmOptions, RigOptions, StageOptions, film};
use serde_json::Value;

/// A folder that goes when it is dropped, in which commands run.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// `erfgs` with these words (separated by blanks), to be run in the folder.
    fn command(&self, words: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_erfgs"));
        command.current_dir(self.0.path()).args(words.split_whitespace());
        command
    }

    fn run(&self, words: &str) -> Output {
        self.command(words).output().expect("erfgs runs")
    }

    /// Runs a command that must succeed, and gives its stdout.
    fn succeed(&self, words: &str) -> String {
        let output = self.run(words);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "erfgs {words}: {}\n{stderr}", output.status);
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    /// The figures that a command that must succeed prints under `--json`.
    fn figures(&self, words: &str) -> Value {
        serde_json::from_str(&self.succeed(&format!("{words} --json"))).expect("JSON")
    }

    /// Runs a command that must fail with the exit code `code`, without a panic, and gives its stderr.
    fn fail(&self, code: i32, words: &str) -> String {
        let output = self.run(words);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "erfgs {words}\n{stderr}");
        assert!(!stderr.contains("panicked") && !stderr.contains("RUST_BACKTRACE"), "erfgs {words}\n{stderr}");
        stderr
    }

    /// A copy of a dataset that was filmed once for all tests.
    fn with_stage(name: &str) -> Self {
        let folder = Self::new();
        copy(STAGE.0.path(), &folder.path(name));
        folder
    }
}

/// Four RGB cameras, two event cameras and a held-out camera before the stage, with random initial points.
static STAGE: LazyLock<Folder> = LazyLock::new(|| {
    let folder = Folder::new();
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width: 48, height: 36, rgb: 4, event: 2, test: 1, ..RigOptions::default() },
        events: EventOptions::default(),
        duration_ns: 300_000_000,
        rgb_fps: 10.0,
        test_fps: 20.0,
        truth_points: 0,
        ..FilmOptions::default()
    };
    film(folder.0.path(), &options, &|_| {}).expect("a film");
    folder.succeed("dataset points . --method random --random-points 400");
    folder
});

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("a folder") {
        let entry = entry.expect("an entry");
        let target = to.join(entry.file_name());
        if entry.file_type().expect("a type").is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("a copy");
        }
    }
}
