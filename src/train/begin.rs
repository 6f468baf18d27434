//! How a training begins: anew, or where it was left, and whether it is the same one then.

use erfgs_dataset::Dataset;
use erfgs_run::{FolderLock, Identity, RunFolder, RunInfo};
use erfgs_train::{
    checkpoint::Checkpoint,
    config::{Config, MotionModel},
    static_set::StaticSet,
};

use crate::{errors::Usage, terminal::Terminal};

/// Takes the run folder for this process.
pub fn alone(folder: &RunFolder, terminal: &Terminal) -> anyhow::Result<FolderLock> {
    let shown = folder.root().display();
    let mut noted = false;
    let lock = FolderLock::wait(folder.root(), || {
        if !std::mem::replace(&mut noted, true) {
            let patience = FolderLock::PATIENCE.as_secs();
            terminal.note(format!("another process trains into {shown}: waiting for its end, {patience} s at most"));
        }
        true
    })?;
    let taken = || Usage(format!("another process trains into {shown}; wait for its end, or give another --out"));
    Ok(lock.ok_or_else(taken)?)
}

/// The checkpoint to go on from, if there is one.
pub fn checkpoint(folder: &RunFolder, resume: bool) -> anyhow::Result<Option<Checkpoint>> {
    match (resume, folder.checkpoint_file().is_file()) {
        (true, true) => Ok(Some(Checkpoint::load(&folder.checkpoint_file())?)),
        (_, false) => {
            // What is finished is not trained again unless somebody decides to.
            let finished = folder.info_file().is_file() && folder.read_info()?.finished;
            let gone = || {
                Usage(format!(
                    "{} is of a finished training, but {} is gone: put it back to go on with the run, or give another --out to train again",
                    folder.info_file().display(),
                    folder.checkpoint_file().display()
                ))
            };
            if finished { Err(gone().into()) } else { Ok(None) }
        }
        (false, true) => Err(Usage(format!(
            "{} holds a run already; add --resume to go on with it, or give another --out",
            folder.root().display()
        ))
        .into()),
    }
}

/// Decides what was left to the data, and whether what stands still is taken over from `set`: not where a field moves everything because
/// no points of what moves are there.
pub fn settle(
    config: &mut Config,
    dataset: &Dataset,
    without_points: bool,
    mut set: Option<StaticSet>,
    begun: Option<&Checkpoint>,
    terminal: &Terminal,
) -> anyhow::Result<Option<StaticSet>> {
    let coarse_iterations = config.coarse_iterations;
    if let Some(set) = &set {
        config.static_set = Some(set.sha256());
        config.coarse_iterations = 0;
    }
    let begun_alone = begun.is_some_and(|checkpoint| checkpoint.config.static_set.is_none());
    let by_the_data = config.motion == MotionModel::Auto || begun_alone;
    config.settle(dataset, without_points)?;
    if by_the_data && config.motion == MotionModel::HexPlane && set.take().is_some() {
        terminal.note(
            "something moves, but no moving points were found: this window is trained by itself, with a deformation field",
        );
        (config.static_set, config.coarse_iterations) = (None, coarse_iterations);
    }
    if by_the_data && config.motion == MotionModel::Bodies {
        terminal.note("the dataset has bodies, which are used for what moves (--motion free-time does not use them)");
    }
    Ok(set)
}

/// How a run that is gone on with stands to what is wanted now.
pub struct Stands {
    /// What was written of it; nothing of a run of before that was.
    info: Option<RunInfo>,
    changed: bool,
}

/// Refuses to go on with a run that was begun with other data or, unless `change` is wanted, with other settings.
pub fn same(folder: &RunFolder, of_checkpoint: &Identity, wanted: &Identity, change: bool) -> anyhow::Result<Stands> {
    let shown = folder.root().display();
    let info = if folder.info_file().is_file() { Some(folder.read_info()?) } else { None };
    let mut begun = of_checkpoint.clone();
    if let Some(info) = &info {
        if let Some(sha256) = info.dataset_sha256.as_ref().filter(|sha256| **sha256 != wanted.dataset_sha256) {
            return Err(Usage(format!(
                "{shown} was trained from another dataset than this one: the manifest of '{}' ({}) had the SHA-256 {sha256}, and this \
                 one has {}; give the dataset as it was then, or another --out",
                info.dataset_name,
                info.dataset.display(),
                wanted.dataset_sha256
            ))
            .into());
        }
        // Runs of before identities do not tell their minutes.
        if info.identity.is_some() {
            begun.budget = [info.minutes, info.cpu_minutes].map(|minutes| minutes.map(|minutes| minutes * 60.0));
        }
    }
    let differences = wanted.differences(&begun);
    if !differences.is_empty() && !change {
        return Err(Usage(format!(
            "{shown} was started with other settings: {}; add --change to continue with the new ones, or give another --out",
            differences.join("; ")
        ))
        .into());
    }
    Ok(Stands { info, changed: !differences.is_empty() })
}

impl Stands {
    /// Whether nothing is left to be done.
    pub fn is_finished(&self, folder: &RunFolder) -> bool {
        let finished = self.info.as_ref().is_some_and(|info| info.finished);
        finished && !self.changed && folder.point_cloud_file().is_file()
    }

    /// The version that the run was begun with, if it is another.
    pub fn other_version(&self) -> Option<&str> {
        let version = &self.info.as_ref()?.version;
        (version != env!("CARGO_PKG_VERSION")).then_some(version)
    }
}
