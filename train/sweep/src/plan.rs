//! The plan: a TOML file that says what is trained with what.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use serde::{Deserialize, Serialize};

use super::SweepError;

/// More runs than this are a slip of the pen.
pub(super) const MOST_JOBS: usize = 100_000;

/// Options of `erfgs train` that a plan may give, without the dashes. The others are the sweep's own business.
const OPTIONS: [&str; 13] = [
    "method",
    "preset",
    "config",
    "motion",
    "iterations",
    "minutes",
    "cpu-minutes",
    "deterministic",
    "no-evaluation",
    "memory",
    "device-memory",
    "init",
    "adapter",
];

/// A plan.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The sweep's name; that of the file unless given.
    #[serde(default)]
    pub name: String,
    /// Where runs, logs and the manifest go; a folder named as the sweep, beside the plan, unless given.
    #[serde(default)]
    pub out: PathBuf,
    /// Folders of datasets.
    #[serde(default)]
    pub datasets: Vec<PathBuf>,
    /// Long takes, cut into windows.
    #[serde(default, rename = "take")]
    pub takes: Vec<Take>,
    /// Seeds; 0 alone unless given.
    #[serde(default = "zero")]
    pub seeds: Vec<u64>,
    /// Whether runs are measured on the held-out cameras once they are trained.
    #[serde(default = "yes")]
    pub evaluate: bool,
    /// Options of `erfgs train`; a list gives a run for each of its entries.
    #[serde(default)]
    pub train: BTreeMap<String, toml::Value>,
    /// Settings (`--set`) by their dotted names; a list gives a run for each of its entries.
    #[serde(default)]
    pub set: BTreeMap<String, toml::Value>,
    /// How jobs are submitted.
    #[serde(default)]
    pub slurm: SlurmOptions,
}

/// A long take.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Take {
    /// The session.
    pub session: PathBuf,
    /// Its rig file.
    pub rig: PathBuf,
    /// Where the first window begins, seconds of session time.
    #[serde(default)]
    pub from: f64,
    /// How long all windows together are, seconds.
    pub seconds: f64,
    /// How long a window is, seconds.
    pub window: f64,
    /// How much of it the next one sees, too, seconds.
    #[serde(default)]
    pub overlap: f64,
    /// Whether the first window is trained first, and the others take over what stands still from it; yes unless given, but where a
    /// field is to move everything.
    #[serde(default = "yes")]
    pub one_static_set: bool,
    /// Whether lenses are taken out of the images, which trainers need; yes unless given.
    #[serde(default = "yes")]
    pub undistort: bool,
    /// More words of `erfgs dataset import session`.
    #[serde(default)]
    pub import: Vec<String>,
    /// More words of `erfgs dataset points`.
    #[serde(default)]
    pub points: Vec<String>,
}

/// How jobs are submitted.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SlurmOptions {
    /// Options of `sbatch`: `"--partition=gpu"`.
    #[serde(default)]
    pub options: Vec<String>,
    /// Lines of the job before the training: `"module load vulkan"`.
    #[serde(default)]
    pub setup: Vec<String>,
    /// Jobs that may run at once; as many as there is room for unless given.
    #[serde(default)]
    pub at_once: Option<u32>,
    /// Seconds between the request to stop and the end of a job's time, in which its checkpoint is saved; 120 unless given.
    #[serde(default)]
    pub grace: Option<u32>,
}

fn zero() -> Vec<u64> {
    vec![0]
}

fn yes() -> bool {
    true
}

impl Plan {
    /// Reads a plan. Its paths are made absolute: they are beside the file.
    ///
    /// # Errors
    /// [`SweepError::Plan`] says what is wrong with it.
    pub fn load(path: &Path) -> Result<Self, SweepError> {
        let text = erfgs_base::text::read(path).map_err(FileError::when("read", path))?;
        let wrong = |message: String| SweepError::Plan { path: path.to_owned(), message };
        let mut plan: Self = toml::from_str(&text).map_err(|error| wrong(error.to_string().trim().to_owned()))?;
        let absolute = std::path::absolute(path).map_err(FileError::when("read", path))?;
        let beside = absolute.parent().unwrap_or(Path::new("/"));
        if plan.name.is_empty() {
            plan.name = absolute.file_stem().map_or_else(|| "sweep".into(), |stem| stem.to_string_lossy().into_owned());
        }
        plan.name = plain(&plan.name);
        plan.out = beside.join(if plan.out.as_os_str().is_empty() { Path::new(&plan.name) } else { &plan.out });
        for folder in &mut plan.datasets {
            *folder = beside.join(&folder);
        }
        for take in &mut plan.takes {
            take.session = beside.join(&take.session);
            take.rig = beside.join(&take.rig);
        }
        if let Some(config) = plan.train.get_mut("config") {
            let inside = |value: &mut toml::Value| {
                if let toml::Value::String(path) = value {
                    *path = beside.join(&*path).to_string_lossy().into_owned();
                }
            };
            match config {
                toml::Value::Array(entries) => entries.iter_mut().for_each(inside),
                value => inside(value),
            }
        }
        plan.check().map_err(wrong)?;
        Ok(plan)
    }

    fn check(&self) -> Result<(), String> {
        if self.datasets.is_empty() && self.takes.is_empty() {
            return Err("it has neither `datasets` nor a [[take]], and so nothing to train".into());
        }
        if self.seeds.is_empty() {
            return Err("`seeds` is an empty list".into());
        }
        if let Some(option) = self.train.keys().find(|option| !OPTIONS.contains(&option.as_str())) {
            return Err(format!("[train] has '{option}'; it may have {}", OPTIONS.join(", ")));
        }
        for (key, value) in self.train.iter().chain(&self.set) {
            if value.as_array().is_some_and(Vec::is_empty) {
                return Err(format!("'{key}' is an empty list, which gives no run"));
            }
            let values = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
            if values.iter().any(|value| value.is_table() || value.is_datetime()) {
                return Err(format!(
                    "'{key}' is neither a number, a word, a switch nor a list of these; write names with \
                                    dots in quotes: \"earl.weight\" = 1.0"
                ));
            }
        }
        for take in &self.takes {
            let name = take.session.display();
            let times = [take.from, take.seconds, take.window, take.overlap];
            if times.iter().any(|time| !time.is_finite() || *time < 0.0) || take.seconds <= 0.0 || take.window <= 0.0 {
                return Err(format!("the times of take '{name}' are not positive durations"));
            }
            if take.overlap >= take.window {
                return Err(format!(
                    "the windows of take '{name}' overlap by {} s and are {} s long",
                    take.overlap, take.window
                ));
            }
            if take.windows_count() > MOST_JOBS {
                return Err(format!("take '{name}' has more than {MOST_JOBS} windows"));
            }
        }
        if self.slurm.options.iter().chain(&self.slurm.setup).any(|line| line.contains(['\n', '\r', '\0'])) {
            return Err("an entry of [slurm] has more than one line".into());
        }
        Ok(())
    }
}

impl Take {
    fn windows_count(&self) -> usize {
        if self.seconds <= self.window {
            return 1;
        }
        // What rounding adds is no window of its own.
        (((self.seconds - self.overlap) / (self.window - self.overlap)) - 1e-9).ceil().max(1.0) as usize
    }

    /// Beginning and length of every window, seconds. The last ends where the take does and is as long as the others, so
    /// that it shares more with the one before.
    pub(super) fn windows(&self) -> Vec<(f64, f64)> {
        let length = self.window.min(self.seconds);
        let last = self.from + self.seconds - length;
        let step = self.window - self.overlap;
        // To the microsecond, so that no tail of digits is told.
        let round = |seconds: f64| (seconds * 1e6).round() / 1e6;
        (0..self.windows_count()).map(|at| (round((self.from + at as f64 * step).min(last)), round(length))).collect()
    }
}

/// `name` as that of a folder, a job and a file: ASCII letters, digits, `-`, `_`, `.` and `+`.
pub(super) fn plain(name: &str) -> String {
    let plain: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | '+') { c } else { '-' })
        .take(100)
        .collect();
    let plain = plain.trim_start_matches(['.', '-']).to_owned();
    if plain.is_empty() { "sweep".into() } else { plain }
}
