//! `sweep.json`: what a plan came to. Jobs know nothing but this.

use std::{
    collections::{BTreeMap, BTreeSet},
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
    /// [`SweepError::File`], and [`SweepError::Newer`] where a newer program wrote the one that is there, whose runs might have other names.
    pub fn save(&self) -> Result<(), SweepError> {
        let path = self.folder.join("sweep.json");
        // One that is damaged holds nothing that the plan does not.
        if let Some(before) = erfgs_base::text::read(&path).ok().and_then(|text| serde_json::from_str(&text).ok()) {
            version(&path, &before)?;
        }
        write_json(&path, self)
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
        let text = erfgs_base::text::read(&path).map_err(FileError::when("read", &path))?;
        let wrong = |message: String| SweepError::Manifest { path: path.clone(), message };
        let head: serde_json::Value = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        version(&path, &head)?;
        let mut found: Self = serde_json::from_value(head).map_err(|error| wrong(error.to_string()))?;
        if found.format != FORMAT {
            return Err(wrong(format!("it is '{}'", found.format)));
        }
        found.check().map_err(wrong)?;
        found.folder = std::path::absolute(folder).map_err(FileError::when("read", folder))?;
        Ok(found)
    }

    /// Says what is wrong with the jobs, if something is: names become paths, and each job has to become ready at some time.
    fn check(&self) -> Result<(), String> {
        let mut named: BTreeMap<&str, &Job> = BTreeMap::new();
        for job in &self.jobs {
            if super::plan::plain(&job.name) != job.name {
                return Err(format!("'{}' is no name of a job", job.name));
            }
            if named.insert(&job.name, job).is_some() {
                return Err(format!("two jobs are called '{}'", job.name));
            }
        }
        // Jobs that are known to become ready.
        let mut becomes_ready: BTreeSet<&str> = BTreeSet::new();
        for job in &self.jobs {
            let (mut at, mut way) = (job, BTreeSet::from([job.name.as_str()]));
            while let Some(before) = at.after.as_deref().filter(|before| !becomes_ready.contains(before)) {
                if !way.insert(before) {
                    return Err(format!("job '{}' waits for '{before}', which waits for it", at.name));
                }
                let missing = || format!("job '{}' waits for '{before}', which is not among its jobs", at.name);
                at = named.get(before).ok_or_else(missing)?;
            }
            becomes_ready.extend(way);
        }
        Ok(())
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

/// Refuses a manifest of a version that is not known, whatever it holds besides.
fn version(path: &Path, manifest: &serde_json::Value) -> Result<(), SweepError> {
    let found = manifest["version"].as_u64().unwrap_or(0).try_into().unwrap_or(u32::MAX);
    let is_known = manifest["format"] != FORMAT || found <= VERSION;
    if is_known { Ok(()) } else { Err(SweepError::Newer { path: path.into(), found, known: VERSION }) }
}

/// Whether the evaluation is of the training as it ended, by what they say of it: files tell nothing by their times where clocks are
/// set, or folders copied.
pub(super) fn is_measured(run: &RunFolder) -> bool {
    let (Ok(metrics), Ok(curve)) = (run.read_metrics(), run.read_curve()) else { return false };
    // The curve is written a moment before the last checkpoint, and rounds to milliseconds.
    const SECONDS: f64 = 1.0;
    curve.rows.last().is_some_and(|last| {
        // A training that is to be repeated to the byte keeps no times.
        let is_as_long = metrics.train_seconds == 0.0 || (last.wall_seconds - metrics.train_seconds).abs() < SECONDS;
        (last.iteration, last.gaussians) == (metrics.iterations, metrics.gaussians) && is_as_long
    })
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
    let text = erfgs_base::text::read(&path).map_err(FileError::when("read", &path))?;
    let manifest: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    if !at_random && manifest.get("points").is_none_or(serde_json::Value::is_null) {
        return Err(SweepError::NoPoints { folder: folder.into() });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use erfgs_run::{CurveRow, MaskKind, Metrics, Part, RunInfo};

    fn job(name: &str, after: Option<&str>) -> serde_json::Value {
        serde_json::json!({"name": name, "dataset": "ds", "after": after, "seed": 0, "settings": {}, "arguments": []})
    }

    fn manifest(folder: &Path, jobs: &[serde_json::Value]) -> Result<Manifest, SweepError> {
        let value = serde_json::json!({"format": FORMAT, "version": 1, "name": "s", "evaluate": true, "jobs": jobs});
        std::fs::write(folder.join("sweep.json"), value.to_string()).unwrap();
        Manifest::load(folder)
    }

    #[test]
    fn jobs_that_would_wait_for_ever_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |jobs: &[serde_json::Value]| manifest(folder.path(), jobs).unwrap_err().to_string();
        assert!(manifest(folder.path(), &[job("b", Some("a")), job("c", Some("b")), job("a", None)]).is_ok());
        let unknown = refused(&[job("a", None), job("b", Some("gone"))]);
        assert!(unknown.contains("'b' waits for 'gone', which is not among its jobs"), "{unknown}");
        for cycle in [
            vec![job("a", Some("a"))],
            vec![job("x", None), job("a", Some("b")), job("b", Some("a"))],
            vec![job("d", Some("a")), job("a", Some("b")), job("b", Some("c")), job("c", Some("a"))],
        ] {
            let message = refused(&cycle);
            assert!(message.contains("which waits for it") && message.contains("sweep.json"), "{message}");
        }
        assert!(refused(&[job("a", None), job("a", None)]).contains("two jobs are called 'a'"));
        assert!(refused(&[job("../a", None)]).contains("no name of a job"));
    }

    #[test]
    fn a_long_chain_is_looked_through_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let before = |n: usize| n.checked_sub(1).map(|n| format!("j{n}"));
        let jobs: Vec<_> = (0..20_000).rev().map(|n| job(&format!("j{n}"), before(n).as_deref())).collect();
        assert!(manifest(folder.path(), &jobs).is_ok());
    }

    /// What a run says decides, and not when its files were written: clocks are set back.
    #[test]
    fn an_evaluation_is_known_by_what_it_is_of() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = manifest(folder.path(), &[job("a", None)]).unwrap();
        let run = manifest.run(&manifest.jobs[0]);
        run.write_info(&RunInfo { finished: true, ..RunInfo::default() }).unwrap();
        let row = |iteration, wall_seconds| CurveRow {
            iteration,
            stage: "fine".into(),
            wall_seconds,
            gaussians: 70,
            ..CurveRow::default()
        };
        let mut curve = run.create_curve().unwrap();
        curve.append(&row(50, 1.25)).unwrap();
        curve.append(&row(100, 2.5)).unwrap();
        assert!(!manifest.is_done(&manifest.jobs[0]), "nothing was measured");
        let metrics = Metrics {
            psnr: 20.0,
            dpsnr: None,
            dpsnr_pooled: None,
            dpsnr_mask: MaskKind::Motion,
            psnr_static: None,
            psnr_fast: None,
            at_frames: Part::default(),
            between_frames: Part::default(),
            outside_frames: Part::default(),
            colour_corrected: None,
            ssim: 0.9,
            lpips: None,
            lpips_kind: None,
            train_psnr: None,
            iterations: 100,
            train_seconds: 2.5004,
            train_cpu_seconds: None,
            gaussians: 70,
            bytes: 1,
            render_fps: 1.0,
        };
        run.write_metrics(&metrics).unwrap();
        // A checkpoint that is later by the clock, as after a copy or before the clock was set back.
        std::fs::write(run.checkpoint_file(), b"x").unwrap();
        let later = std::time::SystemTime::now() + std::time::Duration::from_secs(3600);
        std::fs::File::options().write(true).open(run.checkpoint_file()).unwrap().set_modified(later).unwrap();
        assert!(manifest.is_done(&manifest.jobs[0]));
        run.write_metrics(&Metrics { train_seconds: 0.0, ..metrics.clone() }).unwrap();
        assert!(manifest.is_done(&manifest.jobs[0]), "one that keeps no times");
        // Trained on, or anew: what was measured is of another training.
        curve.append(&row(150, 4.0)).unwrap();
        assert!(!manifest.is_done(&manifest.jobs[0]));
        run.write_metrics(&Metrics { iterations: 150, train_seconds: 90.0, ..metrics }).unwrap();
        assert!(!manifest.is_done(&manifest.jobs[0]));
    }
}
