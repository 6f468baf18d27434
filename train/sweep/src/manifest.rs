//! `sweep.json`: what a plan came to. Jobs know nothing but this.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, atomic};
use erfgs_run::RunFolder;
use serde::{Deserialize, Serialize};

use super::{Plan, SweepError, plan::SlurmOptions};

/// Version of the format.
const VERSION: u32 = 1;
/// Its name.
const FORMAT: &str = "erfgs-sweep";

/// A run to be trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// Its name, and that of its run folder.
    pub name: String,
    /// The dataset.
    pub dataset: PathBuf,
    /// How the dataset is made, where it is a window of a take.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preparation: Option<Preparation>,
    /// Which part of which take it is, where it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
    /// The job that must be done before, from which it takes what stands still.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after: Option<String>,
    /// The seed.
    pub seed: u64,
    /// What tells it from other runs, beside dataset and seed.
    pub settings: BTreeMap<String, String>,
    /// Options of `erfgs train`.
    pub arguments: Vec<String>,
}

impl Job {
    /// The graphics adapter that it trains on, where its options name one.
    #[must_use]
    pub fn adapter(&self) -> Option<&str> {
        self.arguments.iter().find_map(|word| word.strip_prefix("--adapter="))
    }
}

/// A window of a take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Window {
    /// The take.
    pub take: String,
    /// Where it begins, seconds of session time.
    pub from: f64,
    /// How long it is, seconds.
    pub seconds: f64,
}

/// How the dataset of a window is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Preparation {
    /// The words of the command that imports it, without `--out`.
    pub import: Vec<String>,
    /// Whether lenses are taken out of the images.
    pub undistort: bool,
    /// More words of the command that makes its points.
    pub points: Vec<String>,
}

/// A sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    format: String,
    version: u32,
    /// Its name.
    pub name: String,
    /// Whether runs are measured once they are trained.
    pub evaluate: bool,
    /// How jobs are submitted.
    #[serde(default)]
    pub slurm: SlurmOptions,
    /// The jobs.
    pub jobs: Vec<Job>,
    /// The folder that it lies in.
    #[serde(skip)]
    pub folder: PathBuf,
}

impl Manifest {
    /// What a plan comes to. `check` says what is wrong with the options of a training.
    ///
    /// # Errors
    /// [`SweepError`] if a dataset is missing or not ready, or the options are wrong.
    pub fn of_plan(plan: &Plan, path: &Path, check: impl Fn(&Job) -> Result<(), String>) -> Result<Self, SweepError> {
        let jobs = plan.jobs()?;
        for folder in &plan.datasets {
            let at_random = plan.train.get("init").is_some_and(|init| init.as_str() == Some("random"));
            ready(folder, at_random)?;
        }
        for job in &jobs {
            let wrong = |message| SweepError::Plan { path: path.into(), message: format!("{}: {message}", job.name) };
            check(job).map_err(wrong)?;
        }
        let (name, evaluate, folder) = (plan.name.clone(), plan.evaluate, plan.out.clone());
        let slurm = plan.slurm.clone();
        Ok(Self { format: FORMAT.into(), version: VERSION, name, evaluate, slurm, jobs, folder })
    }

    /// Writes it.
    ///
    /// # Errors
    /// [`SweepError::File`].
    pub fn save(&self) -> Result<(), SweepError> {
        write_json(&self.folder.join("sweep.json"), self)
    }

    /// Whether there is a sweep in a folder.
    #[must_use]
    pub fn is_in(folder: &Path) -> bool {
        folder.join("sweep.json").is_file()
    }

    /// Reads that of a folder.
    ///
    /// # Errors
    /// [`SweepError`] if there is none, or it is of another kind.
    pub fn load(folder: &Path) -> Result<Self, SweepError> {
        if !Self::is_in(folder) {
            return Err(SweepError::NoSweep { folder: folder.into() });
        }
        let path = folder.join("sweep.json");
        let text = std::fs::read_to_string(&path).map_err(FileError::when("read", &path))?;
        let wrong = |message: String| SweepError::Manifest { path: path.clone(), message };
        let mut found: Self = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        if found.format != FORMAT || found.version > VERSION {
            return Err(wrong(format!("it is '{}' of version {}", found.format, found.version)));
        }
        // Names become paths.
        if let Some(job) = found.jobs.iter().find(|job| super::plan::plain(&job.name) != job.name) {
            return Err(wrong(format!("'{}' is no name of a job", job.name)));
        }
        found.folder = std::path::absolute(folder).map_err(FileError::when("read", folder))?;
        Ok(found)
    }

    /// A job by its name.
    ///
    /// # Errors
    /// [`SweepError::NoJob`].
    pub fn job(&self, name: &str) -> Result<&Job, SweepError> {
        let found = self.jobs.iter().find(|job| job.name == name);
        found.ok_or_else(|| SweepError::NoJob { folder: self.folder.clone(), name: name.into() })
    }

    /// Whether nothing has to be waited for before a job can begin.
    #[must_use]
    pub fn is_ready(&self, job: &Job) -> bool {
        job.after.as_ref().is_none_or(|name| self.job(name).is_ok_and(|before| self.is_done(before)))
    }

    /// The run folder of a job.
    #[must_use]
    pub fn run(&self, job: &Job) -> RunFolder {
        RunFolder::new(self.folder.join("runs").join(&job.name))
    }

    /// The folder that whoever works on a job locks.
    pub(super) fn lock_of(&self, job: &Job) -> PathBuf {
        self.folder.join("locks").join(&job.name)
    }

    /// What a job's commands say.
    #[must_use]
    pub fn log(&self, job: &Job) -> PathBuf {
        self.folder.join("logs").join(format!("{}.log", job.name))
    }

    /// The runs that are trained, and measured if that is wanted.
    #[must_use]
    pub fn done(&self) -> Vec<RunFolder> {
        self.jobs.iter().filter(|job| self.is_done(job)).map(|job| self.run(job)).collect()
    }

    /// Whether nothing is left to be done for a job.
    #[must_use]
    pub fn is_done(&self, job: &Job) -> bool {
        let run = self.run(job);
        run.read_info().is_ok_and(|info| info.finished) && (!self.evaluate || is_measured(&run))
    }
}

/// Whether the evaluation is of the training as it ended.
pub(super) fn is_measured(run: &RunFolder) -> bool {
    let written = |path: PathBuf| std::fs::metadata(path).and_then(|file| file.modified()).ok();
    match (written(run.metrics_file()), written(run.checkpoint_file())) {
        (Some(measured), Some(trained)) => measured >= trained,
        _ => false,
    }
}

/// Writes JSON in one step.
pub(super) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), SweepError> {
    // Strings, numbers and maps with string keys always have one.
    let mut text = serde_json::to_string_pretty(value).unwrap_or_default();
    text.push('\n');
    Ok(atomic::write(path, text.as_bytes()).map_err(FileError::when("write", path))?)
}

/// Whether a dataset can be trained by many at once.
fn ready(folder: &Path, at_random: bool) -> Result<(), SweepError> {
    let path = folder.join("dataset.json");
    if !path.is_file() {
        return Err(SweepError::NoDataset { folder: folder.into() });
    }
    let text = std::fs::read_to_string(&path).map_err(FileError::when("read", &path))?;
    let manifest: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    if !at_random && manifest.get("points").is_none_or(serde_json::Value::is_null) {
        return Err(SweepError::NoPoints { folder: folder.into() });
    }
    Ok(())
}
