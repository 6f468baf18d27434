//! Where the jobs of a sweep stand, by what lies in their run folders and, on Slurm, by its queue.

use std::collections::BTreeMap;

use erfgs_run::{FolderLock, RunFolder};
use serde::Serialize;

use super::{
    damage,
    manifest::{Job, Manifest},
    work::Record,
};

/// Jobs that somebody is known to work on, or to be about to, by their names.
pub type Queue = BTreeMap<String, JobState>;

/// Where a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum JobState {
    /// Nothing is left to be done.
    Done,
    /// Somebody works on it.
    Running,
    /// It is submitted and waits for room.
    Queued,
    /// It was begun, and goes on when it is started again.
    Stopped,
    /// The last attempt failed.
    Failed,
    /// It was not begun.
    Waiting,
}

impl JobState {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Running => "running",
            Self::Queued => "queued",
            Self::Stopped => "stopped",
            Self::Failed => "failed",
            Self::Waiting => "waiting",
        }
    }

    /// All of them, in the order in which they are told.
    pub const ALL: [Self; 6] = [Self::Done, Self::Running, Self::Queued, Self::Stopped, Self::Failed, Self::Waiting];
}

/// A job and where it stands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JobStatus {
    /// The job's name.
    pub name: String,
    /// Where it stands.
    pub state: JobState,
    /// How much of its training is done, 0 to 1.
    pub share: f64,
    /// Iterations done.
    pub iterations: u64,
    /// Seconds of training.
    pub seconds: f64,
    /// PSNR on the held-out cameras: measured, or at the last look during training.
    pub psnr: Option<f64>,
    /// PSNR of moving pixels, likewise.
    pub dpsnr: Option<f64>,
    /// How often it was started.
    pub attempts: u32,
    /// The machine of the last attempt.
    pub node: String,
    /// Why the last attempt failed, if it did, or which of its files is damaged.
    pub failed: Option<String>,
}

/// All jobs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Overview {
    /// Each of them.
    pub jobs: Vec<JobStatus>,
}

/// Runs that are done and differ by their seeds alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OverSeeds {
    /// What their names have in common.
    pub name: String,
    /// How many they are.
    pub runs: usize,
    /// Mean and standard deviation of PSNR, dB.
    pub psnr: Option<[f64; 2]>,
    /// Mean and standard deviation of DPSNR, dB.
    pub dpsnr: Option<[f64; 2]>,
}

impl Overview {
    /// Where the jobs of a sweep stand. `queue` is what is known beside what their folders say.
    #[must_use]
    pub fn of(manifest: &Manifest, queue: &Queue) -> Self {
        Self { jobs: manifest.jobs.iter().map(|job| status(manifest, job, queue)).collect() }
    }

    /// How many jobs are in a state.
    #[must_use]
    pub fn count(&self, state: JobState) -> usize {
        self.jobs.iter().filter(|job| job.state == state).count()
    }

    /// What the runs that are done say over their seeds, where there are at least two of each.
    #[must_use]
    pub fn over_seeds(&self) -> Vec<OverSeeds> {
        let mut groups: BTreeMap<&str, Vec<&JobStatus>> = BTreeMap::new();
        for job in self.jobs.iter().filter(|job| job.state == JobState::Done) {
            let name = job.name.rsplit_once("-s").map_or(&*job.name, |(name, _)| name);
            groups.entry(name).or_default().push(job);
        }
        let several = groups.into_iter().filter(|(_, jobs)| jobs.len() > 1);
        several
            .map(|(name, jobs)| OverSeeds {
                name: name.to_owned(),
                runs: jobs.len(),
                psnr: spread(jobs.iter().filter_map(|job| job.psnr).collect()),
                dpsnr: spread(jobs.iter().filter_map(|job| job.dpsnr).collect()),
            })
            .collect()
    }

    /// How much of all work is done, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.jobs.iter().map(|job| job.share).sum::<f64>() / self.jobs.len().max(1) as f64
    }

    /// `5 done, 2 running, 1 failed`.
    #[must_use]
    pub fn words(&self) -> String {
        let counts = JobState::ALL.into_iter().map(|state| (self.count(state), state.name()));
        counts
            .filter(|(count, _)| *count > 0)
            .map(|(count, name)| format!("{count} {name}"))
            .collect::<Vec<_>>()
            .join(", ")
    }
}

/// Mean and standard deviation of a sample; nothing of fewer than two.
fn spread(values: Vec<f64>) -> Option<[f64; 2]> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (values.len() > 1).then(|| [mean, variance.sqrt()])
}

fn status(manifest: &Manifest, job: &Job, queue: &Queue) -> JobStatus {
    let run = manifest.run(job);
    let damage = damage::of(manifest, job);
    let record = Record::of(manifest, job).unwrap_or_default();
    let done = manifest.is_done(job);
    let trained = Trained::of(&run);
    let state = match queue.get(&job.name) {
        _ if done => JobState::Done,
        Some(state) => *state,
        None if FolderLock::is_taken(&manifest.lock_of(job)) => JobState::Running,
        None if damage.is_some() || record.failed.is_some() => JobState::Failed,
        None if record.attempts > 0 => JobState::Stopped,
        None => JobState::Waiting,
    };
    let metrics = done.then(|| run.read_metrics().ok()).flatten();
    JobStatus {
        name: job.name.clone(),
        state,
        share: if done { 1.0 } else { trained.share.clamp(0.0, 1.0) },
        iterations: trained.iterations,
        seconds: trained.seconds,
        psnr: metrics.as_ref().map(|metrics| metrics.psnr).or(trained.psnr),
        dpsnr: metrics.as_ref().map_or(trained.dpsnr, |metrics| metrics.dpsnr),
        attempts: record.attempts,
        node: record.node,
        failed: damage.or(record.failed.filter(|_| state == JobState::Failed)),
    }
}

/// How far a training is.
#[derive(Default)]
struct Trained {
    share: f64,
    iterations: u64,
    seconds: f64,
    psnr: Option<f64>,
    dpsnr: Option<f64>,
}

impl Trained {
    /// By its curve; nothing where there is none.
    fn of(run: &RunFolder) -> Self {
        let Ok(curve) = run.read_curve() else { return Self::default() };
        let Some(last) = curve.rows.last() else { return Self::default() };
        let whole = |key: &str| -> Option<f64> { Some(run.read_config().ok()?.get(key)?.as_integer()? as f64) };
        let iterations = whole("coarse_iterations").zip(whole("fine_iterations")).map(|(coarse, fine)| coarse + fine);
        let info = run.read_info().ok();
        let minutes = info.as_ref().map(|info| (info.minutes, info.cpu_minutes)).unwrap_or_default();
        // Whichever is further ahead ends it.
        let shares = [
            iterations.map(|all| last.iteration as f64 / all.max(1.0)),
            minutes.0.map(|minutes| last.wall_seconds / (60.0 * minutes)),
            minutes.1.zip(last.cpu_seconds).map(|(minutes, seconds)| seconds / (60.0 * minutes)),
        ];
        Self {
            share: shares.into_iter().flatten().fold(0.0, f64::max),
            iterations: last.iteration,
            seconds: last.wall_seconds,
            psnr: curve.rows.iter().rev().find_map(|row| row.psnr),
            dpsnr: curve.rows.iter().rev().find_map(|row| row.dpsnr),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_taken_together_once_two_are_done() {
        let job = |name: &str, state, psnr| JobStatus {
            name: name.into(),
            state,
            share: 1.0,
            iterations: 1,
            seconds: 1.0,
            psnr: Some(psnr),
            dpsnr: None,
            attempts: 1,
            node: String::new(),
            failed: None,
        };
        let jobs = vec![
            job("ds-a-s1", JobState::Done, 20.0),
            job("ds-b-s1", JobState::Done, 25.0),
            job("ds-a-s2", JobState::Done, 22.0),
            job("ds-a-s3", JobState::Running, 90.0),
        ];
        let found = Overview { jobs }.over_seeds();
        let expected = OverSeeds { name: "ds-a".into(), runs: 2, psnr: Some([21.0, 2f64.sqrt()]), dpsnr: None };
        assert_eq!(found, [expected]);
    }
}
