//! One job: its steps, each a command of the program, until all are done or somebody wants it to stop.

use std::{
    fs::{File, OpenOptions},
    io::{Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use erfgs_base::{FileError, children};
use erfgs_run::FolderLock;
use serde::{Deserialize, Serialize};

use super::{
    SweepError, damage,
    manifest::{Job, Manifest, Preparation, is_measured, write_json},
    shell,
};

/// How often is looked whether a step has ended, or is to.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// The exit code of commands that were stopped in good order.
const STOPPED: i32 = 130;

/// How work on a job ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Nothing is left to be done.
    Done,
    /// It was asked to stop, and goes on where it was when it is started again.
    Stopped,
    /// It cannot go on by itself.
    Failed {
        /// Why.
        message: String,
    },
}

/// What the last attempt at a job came to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Record {
    /// How often it was started.
    pub attempts: u32,
    /// The machine of the last attempt.
    pub node: String,
    /// Why the last attempt failed, if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
}

impl Record {
    fn path(manifest: &Manifest, job: &Job) -> PathBuf {
        manifest.folder.join("jobs").join(format!("{}.json", job.name))
    }

    /// That of a job; an empty one where it was never started.
    ///
    /// # Errors
    /// [`SweepError::JobRecord`] if it cannot be read.
    pub(super) fn of(manifest: &Manifest, job: &Job) -> Result<Self, SweepError> {
        let path = Self::path(manifest, job);
        let read = match erfgs_base::text::read(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => Err(error.to_string()),
            Ok(text) => serde_json::from_str(&text).map_err(|error| error.to_string()),
        };
        read.map_err(|what| SweepError::JobRecord { path, what })
    }
}

/// Works on a job until it is done, or `stop` is set: what runs then is asked to save and to end. `program` is the one that
/// the steps are commands of.
///
/// # Errors
/// [`SweepError`] if the sweep's own files cannot be written; that a step fails is no error, but [`Ended::Failed`].
pub fn work(manifest: &Manifest, job: &Job, program: &Path, stop: &AtomicBool) -> Result<Ended, SweepError> {
    let Some(_alone) = FolderLock::wait(&manifest.lock_of(job), || !stop.load(Ordering::Relaxed))? else {
        return Ok(match stop.load(Ordering::Relaxed) {
            true => Ended::Stopped,
            false => Ended::Failed { message: "another process works on it".into() },
        });
    };
    if let Some(message) = damage::of(manifest, job) {
        return Ok(Ended::Failed { message });
    }
    let attempts = Record::of(manifest, job)?.attempts.saturating_add(1);
    let mut record = Record { attempts, node: node(), failed: None };
    write_json(&Record::path(manifest, job), &record)?;
    let log = manifest.log(job);
    let hand = Hand { program, log: &log, stop };
    let ended = steps(manifest, job, &hand)?;
    if let Ended::Failed { message } = &ended {
        record.failed = Some(message.clone());
        write_json(&Record::path(manifest, job), &record)?;
    }
    Ok(ended)
}

fn steps(manifest: &Manifest, job: &Job, hand: &Hand<'_>) -> Result<Ended, SweepError> {
    if let Some(preparation) = &job.preparation {
        let ended = prepare(manifest, &job.dataset, preparation, hand)?;
        if ended != Ended::Done {
            return Ok(ended);
        }
    }
    let run = manifest.run(job);
    if let Some(before) = &job.after {
        let before = manifest.job(before)?;
        if !manifest.is_done(before) {
            let message = format!("{} is not done, whose static Gaussians it needs", before.name);
            return Ok(Ended::Failed { message });
        }
    }
    let ended = hand.step(&train_words(manifest, job)?)?;
    if ended != Ended::Done || !manifest.evaluate || is_measured(&run) {
        return Ok(ended);
    }
    hand.step(&eval_words(manifest, job))
}

/// The commands that a job comes to, in their order, each as the words after the program's name. Those that make the dataset of a
/// window are run by the first job that needs it.
///
/// # Errors
/// [`SweepError::NoJob`] if it waits for a job that there is not.
pub fn commands(manifest: &Manifest, job: &Job) -> Result<Vec<Vec<String>>, SweepError> {
    let mut all = job.preparation.as_ref().map_or(Vec::new(), |of| Preparing::new(&job.dataset, of).commands);
    all.push(train_words(manifest, job)?);
    if manifest.evaluate {
        all.push(eval_words(manifest, job));
    }
    Ok(all)
}

fn train_words(manifest: &Manifest, job: &Job) -> Result<Vec<String>, SweepError> {
    let mut words = words(["train"]);
    words.extend([text(&job.dataset), "--out".into(), text(manifest.run(job).root()), "--resume".into()]);
    if let Some(before) = &job.after {
        words.extend(["--static".into(), text(manifest.run(manifest.job(before)?).root())]);
    }
    words.extend(job.arguments.iter().cloned());
    Ok(words)
}

fn eval_words(manifest: &Manifest, job: &Job) -> Vec<String> {
    let mut words = words(["eval"]);
    words.push(text(manifest.run(job).root()));
    // It is measured where it was trained.
    words.extend(job.adapter().map(|name| format!("--adapter={name}")));
    words
}

/// How the dataset of a window is made.
struct Preparing {
    /// What is imported, and what becomes the dataset.
    imported: PathBuf,
    ready: PathBuf,
    commands: Vec<Vec<String>>,
}

impl Preparing {
    fn new(folder: &Path, preparation: &Preparation) -> Self {
        let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let imported = folder.with_file_name(format!("{name}.imported"));
        let ready =
            if preparation.undistort { folder.with_file_name(format!("{name}.pinhole")) } else { imported.clone() };
        let mut import = preparation.import.clone();
        import.extend(["--out".into(), text(&imported)]);
        let mut commands = vec![import];
        if preparation.undistort {
            let mut undistort = words(["dataset", "undistort"]);
            undistort.extend([text(&imported), "--out".into(), text(&ready)]);
            commands.push(undistort);
        }
        let mut points = words(["dataset", "points"]);
        points.push(text(&ready));
        points.extend(preparation.points.iter().cloned());
        commands.push(points);
        Self { imported, ready, commands }
    }
}

/// Makes the dataset of a window, unless it is there: several jobs may need the same one.
fn prepare(
    manifest: &Manifest,
    folder: &Path,
    preparation: &Preparation,
    hand: &Hand<'_>,
) -> Result<Ended, SweepError> {
    let is_there = || folder.join("dataset.json").is_file();
    let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let lock = manifest.folder.join("locks").join(format!("dataset-{name}"));
    loop {
        if is_there() {
            return Ok(Ended::Done);
        }
        if hand.is_to_stop() {
            return Ok(Ended::Stopped);
        }
        let Some(_alone) = FolderLock::take(&lock)? else {
            std::thread::sleep(LOOK_EVERY);
            continue;
        };
        if is_there() {
            return Ok(Ended::Done);
        }
        let Preparing { imported, ready, commands } = Preparing::new(folder, preparation);
        // What an attempt left that was killed.
        let clear = |folder: &Path| match std::fs::remove_dir_all(folder) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(FileError::when("remove", folder)(error)),
            _ => Ok(()),
        };
        clear(&imported)?;
        clear(&ready)?;
        for words in commands {
            let ended = hand.step(&words)?;
            if ended != Ended::Done {
                return Ok(ended);
            }
        }
        std::fs::rename(&ready, folder).map_err(FileError::when("move into its place", &ready))?;
        clear(&imported)?;
        return Ok(Ended::Done);
    }
}

/// Runs commands.
struct Hand<'a> {
    program: &'a Path,
    log: &'a Path,
    stop: &'a AtomicBool,
}

impl Hand<'_> {
    fn is_to_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Runs a command to its end, which comes soon if work is to stop.
    fn step(&self, words: &[String]) -> Result<Ended, SweepError> {
        if self.is_to_stop() {
            return Ok(Ended::Stopped);
        }
        let command = format!("erfgs {}", shell::line(words));
        let mut log = self.open_log()?;
        writeln!(log, "$ {command}").map_err(FileError::when("write", self.log))?;
        let out = log.try_clone().map_err(FileError::when("write", self.log))?;
        let mut step = Command::new(self.program);
        step.args(words).stdin(Stdio::null()).stdout(out).stderr(log);
        // Where this process is killed, what runs is asked to save and to end, as when it is asked to stop.
        children::end_with_us(&mut step, children::Signal::Terminate);
        let mut child = step.spawn().map_err(|source| SweepError::Start { command: command.clone(), source })?;
        let mut asked = false;
        let status = loop {
            match child.try_wait() {
                Ok(Some(status)) => break status,
                Ok(None) => {}
                Err(source) => return Err(SweepError::Start { command, source }),
            }
            if self.is_to_stop() && !std::mem::replace(&mut asked, true) {
                terminate(&mut child);
            }
            std::thread::sleep(LOOK_EVERY);
        };
        Ok(match status.code() {
            Some(0) => Ended::Done,
            Some(STOPPED) => Ended::Stopped,
            // Commands with nothing to save just go.
            None if self.is_to_stop() => Ended::Stopped,
            _ => {
                let step = words.first().map(String::as_str).unwrap_or_default();
                let line = self.last_line();
                Ended::Failed { message: format!("`erfgs {step}` ended with {status}: {line}") }
            }
        })
    }

    fn open_log(&self) -> Result<File, SweepError> {
        let failed = FileError::when("write", self.log);
        if let Some(folder) = self.log.parent() {
            std::fs::create_dir_all(folder).map_err(&failed)?;
        }
        Ok(OpenOptions::new().create(true).append(true).open(self.log).map_err(&failed)?)
    }

    /// The last line of the log that says something.
    fn last_line(&self) -> String {
        const TAIL: u64 = 4096;
        let read = || -> std::io::Result<Vec<u8>> {
            let mut file = File::open(self.log)?;
            let length = file.metadata()?.len();
            file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
            let mut bytes = Vec::new();
            file.take(TAIL).read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        let bytes = read().unwrap_or_default();
        let text = String::from_utf8_lossy(&bytes);
        let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with("see `erfgs"));
        lines.next_back().unwrap_or("it said nothing").to_owned()
    }
}

#[cfg(unix)]
fn terminate(child: &mut Child) {
    use nix::{
        sys::signal::{Signal, kill},
        unistd::Pid,
    };
    if let Ok(id) = i32::try_from(child.id()) {
        // It may have ended by itself.
        let _ = kill(Pid::from_raw(id), Signal::SIGTERM);
    }
}

#[cfg(not(unix))]
fn terminate(child: &mut Child) {
    let _ = child.kill();
}

/// The name of this machine, where it is told.
fn node() -> String {
    // Two nodes of Slurm may be one machine.
    let of_slurm = std::env::var("SLURMD_NODENAME").ok();
    of_slurm
        .or_else(|| std::fs::read_to_string("/proc/sys/kernel/hostname").ok())
        .map(|name| name.trim().to_owned())
        .unwrap_or_default()
}

fn words<const N: usize>(words: [&str; N]) -> Vec<String> {
    words.map(String::from).into()
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plan may name programs, which its reader is to see.
    #[test]
    fn every_word_that_will_run_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let text = r#"{"format": "erfgs-sweep", "version": 1, "name": "s", "evaluate": true, "jobs": [
            {"name": "a", "dataset": "/ds/a", "seed": 1, "settings": {}, "arguments": ["--seed", "1", "--adapter=llvmpipe"],
             "preparation": {"import": ["dataset", "import", "session", "take one.mcap"], "undistort": true,
                             "points": ["--colmap", "/home/me/program; rm -r x"]}},
            {"name": "b", "dataset": "/ds/b", "after": "a", "seed": 1, "settings": {}, "arguments": []}]}"#;
        std::fs::write(folder.path().join("sweep.json"), text).unwrap();
        let manifest = Manifest::load(folder.path()).unwrap();
        let runs = folder.path().join("runs").display().to_string();
        let lines = |job: usize| -> Vec<String> {
            let commands = commands(&manifest, &manifest.jobs[job]).unwrap();
            commands.iter().map(|words| shell::line(words).replace(&runs, "RUNS")).collect()
        };
        assert_eq!(
            lines(0),
            [
                "dataset import session 'take one.mcap' --out /ds/a.imported",
                "dataset undistort /ds/a.imported --out /ds/a.pinhole",
                "dataset points /ds/a.pinhole --colmap '/home/me/program; rm -r x'",
                "train /ds/a --out RUNS/a --resume --seed 1 --adapter=llvmpipe",
                "eval RUNS/a --adapter=llvmpipe",
            ]
        );
        assert_eq!(lines(1), ["train /ds/b --out RUNS/b --resume --static RUNS/a", "eval RUNS/b"]);
    }
}
