//! The trainings of a measurement: a sweep that is done here, and gone on with by the same command.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::atomic::Ordering,
};

use erfgs_sweep::{Job, JobState, Manifest, Overview, Plan, run_here};

use crate::{errors::Stopped, interrupt::stop_flag, sweep, terminal::Terminal};

/// Trains each dataset with each seed by these options of `erfgs train`, in a subfolder of `folder`, and evaluates it.
pub fn plan(name: &str, folder: &Path, datasets: Vec<PathBuf>, seeds: &[u64], options: Vec<(&str, String)>) -> Plan {
    Plan {
        name: name.to_owned(),
        out: folder.join(name),
        datasets,
        takes: Vec::new(),
        seeds: seeds.into(),
        evaluate: true,
        train: options.into_iter().map(|(key, value)| (key.to_owned(), value.into())).collect(),
        set: BTreeMap::new(),
        slurm: Default::default(),
    }
}

/// Does what is left of a plan, so many trainings at once. From then on the program ends when it is asked to after what runs is saved;
/// before, while datasets are made, it ends at once, since the same command makes them again.
pub fn train_here(plan: &Plan, terminal: &Terminal, at_once: usize) -> anyhow::Result<Manifest> {
    let stop = stop_flag("what runs is saved")?;
    let manifest = Manifest::of_plan(plan, &plan.out, sweep::check)?;
    manifest.save()?;
    let bar = terminal.progress(&format!("training, {}", plan.name));
    let show = |overview: &Overview| bar.share(overview.share(), || overview.words());
    let overview = run_here(&manifest, &sweep::program()?, at_once, stop, show)?;
    drop(bar);
    let left = overview.jobs.len() - overview.count(JobState::Done);
    if left > 0 && stop.load(Ordering::Relaxed) {
        return Err(Stopped(format!("stopped with {left} trainings left; the same command continues")).into());
    }
    if let Some(job) = overview.jobs.iter().find(|job| job.state != JobState::Done) {
        let why = job.failed.as_deref().unwrap_or("it was not trained");
        let log = manifest.log(manifest.job(&job.name)?);
        anyhow::bail!("{}: {why}; see {}; the same command retries it", job.name, log.display());
    }
    Ok(manifest)
}

/// The name of the dataset that a job trains.
pub fn dataset_of(job: &Job) -> String {
    job.dataset.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
