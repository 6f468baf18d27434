//! Which bodies carry Gaussians, before a training begins.

use std::sync::atomic::Ordering;

use erfgs_dataset::Dataset;
use erfgs_run::{RunFolder, write_atomically};
use erfgs_train::{
    config::{Config, MotionModel},
    schedule::Budget,
    trainer::Trainer,
    trial::{self, Setting, Trial, Tried},
};
use serde::{Deserialize, Serialize};

use crate::{
    errors::Stopped,
    interrupt::stop_flag,
    progress::duration,
    terminal::{Terminal, table},
};

const FILE: &str = "trial.json";

/// What `trial.json` holds.
#[derive(Serialize, Deserialize)]
struct TrialFile {
    /// Of the training as it was asked for: another one has a trial of its own.
    identity: String,
    #[serde(flatten)]
    trial: Trial,
}

/// The trial that such a run has had, where which bodies carry Gaussians is left to one.
pub fn known(dataset: &Dataset, config: &Config, budget: Budget, folder: &RunFolder) -> anyhow::Result<Option<Trial>> {
    if !trial::is_due(config) {
        return Ok(None);
    }
    let identity = Trainer::identity(dataset, config, budget)?.sha256();
    let text = std::fs::read_to_string(folder.root().join(FILE)).ok();
    let kept = text.and_then(|text| serde_json::from_str::<TrialFile>(&text).ok());
    Ok(kept.filter(|kept| kept.identity == identity).map(|kept| kept.trial))
}

/// Makes a trial where one is due, and keeps what it found.
pub fn make(
    setting: &Setting<'_>,
    budget: Budget,
    folder: &RunFolder,
    terminal: &Terminal,
) -> anyhow::Result<Option<Trial>> {
    if !trial::is_due(setting.config) {
        return Ok(None);
    }
    let identity = Trainer::identity(setting.dataset, setting.config, budget)?.sha256();
    let stop = stop_flag("the trial of bodies ends early")?;
    let bar = terminal.progress("trial of bodies");
    let mut go_on = |step: erfgs_base::Progress| {
        bar.update(step.done, step.total, step.what);
        !stop.load(Ordering::Relaxed)
    };
    let found = trial::trial(setting, budget, &mut go_on)?;
    drop(bar);
    let Some(trial) = found else {
        return Err(Stopped("stopped during the trial of bodies; the same command starts it again".into()).into());
    };
    terminal.note(describe(&trial));
    let kept = TrialFile { identity, trial };
    std::fs::create_dir_all(folder.root())?;
    write_atomically(&folder.root().join(FILE), serde_json::to_string_pretty(&kept)?.as_bytes())?;
    Ok(Some(kept.trial))
}

/// Takes over what a trial found.
pub fn take(config: &mut Config, dataset: &Dataset, trial: &Trial) {
    let free = trial.free();
    let all = dataset.manifest.bodies.as_ref().map_or(0, |file| file.count);
    if free.len() as u64 == all {
        config.motion = MotionModel::FreeTime;
    } else {
        (config.bodies.free, config.bodies.bend) = (free, trial.bend());
    }
}

/// What the terminal shows of a trial.
fn describe(trial: &Trial) -> String {
    let heading =
        ["body", "error of frames", "of events", "against free in time", "must be below", ""].map(str::to_owned);
    let both = |errors: Option<[f64; 2]>, digits: usize| {
        errors.map_or("-".into(), |[carried, free]| format!("{carried:.digits$} / {free:.digits$}"))
    };
    let row = |tried: &Tried| {
        vec![
            tried.body.clone(),
            both(tried.frames, 3),
            both(tried.events, 2),
            tried.ratio().map_or("-".into(), |ratio| format!("{ratio:.2}")),
            format!("{:.2}", tried.below),
            match (tried.carries, tried.bends) {
                (_, true) => "a body that bends",
                (true, false) => "a body",
                (false, _) => "free in time",
            }
            .into(),
        ]
    };
    let rows: Vec<Vec<String>> = std::iter::once(heading.to_vec()).chain(trial.bodies.iter().map(row)).collect();
    format!(
        "trial of {} iterations, {}: error of each body against free-time Gaussians on held-out cameras:\n{}",
        trial.iterations,
        duration(trial.seconds),
        table(&rows)
    )
}
