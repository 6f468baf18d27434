//! Where a calibration by COLMAP is: each step by itself, with the time that is left of it.

use std::{
    sync::{Mutex, PoisonError, mpsc},
    thread,
    time::{Duration, Instant},
};

use erfgs_calibrate::sfm::SfmStep;

use crate::{
    progress::{Progress, duration},
    terminal::Terminal,
};

/// How often a step that says nothing is told to be going on; lines are printed less often than that.
const BEAT: Duration = Duration::from_secs(1);

/// The steps of all runs.
pub struct Steps<'a> {
    terminal: &'a Terminal,
    /// How many runs there are at most; none where steps are not done again and again.
    runs: Option<usize>,
    now: Mutex<Now>,
}

#[derive(Default)]
struct Now {
    run: usize,
    step: Option<(SfmStep, Progress, Instant)>,
}

impl<'a> Steps<'a> {
    /// None begun yet.
    pub fn new(terminal: &'a Terminal, runs: Option<usize>) -> Self {
        Self { terminal, runs, now: Mutex::default() }
    }

    /// Does `work`, which tells its steps to its argument; a step that says nothing for long is told to be going on.
    pub fn during<T>(&self, work: impl FnOnce(&(dyn Fn(SfmStep, usize, usize) + Sync)) -> T) -> T {
        let (done, ended) = mpsc::channel::<()>();
        thread::scope(|scope| {
            scope.spawn(move || {
                while ended.recv_timeout(BEAT) == Err(mpsc::RecvTimeoutError::Timeout) {
                    let now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
                    if let Some((_, progress, _)) = &now.step {
                        progress.still();
                    }
                }
            });
            // Dropped at the end of the work, however that comes.
            let _done = done;
            let found = work(&|step, done, total| self.update(step, done, total));
            *self.now.lock().unwrap_or_else(PoisonError::into_inner) = Now::default();
            found
        })
    }

    fn update(&self, step: SfmStep, done: usize, total: usize) {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        if now.step.as_ref().is_none_or(|(own, ..)| *own != step) {
            now.run += usize::from(step == SfmStep::Images);
            let label = label(step, now.run, self.runs);
            if let Some((before, progress, since)) = now.step.take() {
                drop(progress);
                tracing::debug!("{before} took {}", duration(since.elapsed().as_secs_f64()));
            }
            self.terminal.note(&label);
            now.step = Some((step, self.terminal.progress(&label), Instant::now()));
        }
        if let Some((_, progress, _)) = &now.step {
            progress.update(done as u64, total as u64, unit(step));
        }
    }
}

/// `run 2 of 3 at most: features`.
fn label(step: SfmStep, run: usize, runs: Option<usize>) -> String {
    match runs {
        Some(runs) => format!("run {run} of {runs} at most: {step}"),
        None => step.to_string(),
    }
}

/// What is counted in a step.
fn unit(step: SfmStep) -> &'static str {
    match step {
        SfmStep::Images | SfmStep::Features | SfmStep::Mapping => "pictures",
        SfmStep::Matching | SfmStep::Refining => "pairs",
        SfmStep::Verifying => "steps",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_told_with_their_run() {
        assert_eq!(label(SfmStep::Features, 2, Some(3)), "run 2 of 3 at most: features");
        assert_eq!(label(SfmStep::Refining, 1, None), "refining");
        let terminal = Terminal::default();
        let steps = Steps::new(&terminal, Some(3));
        let states = steps.during(|tell| {
            let mut states = Vec::new();
            for (step, done) in [
                (SfmStep::Images, 0),
                (SfmStep::Images, 5),
                (SfmStep::Features, 1),
                (SfmStep::Refining, 3),
                (SfmStep::Images, 0),
                (SfmStep::Features, 1),
            ] {
                tell(step, done, 5);
                let now = steps.now.lock().unwrap();
                states.push((now.run, now.step.as_ref().map(|(step, ..)| *step)));
            }
            states
        });
        let runs: Vec<usize> = states.iter().map(|(run, _)| *run).collect();
        assert_eq!(runs, [1, 1, 1, 1, 2, 2]);
        assert!(steps.now.lock().unwrap().step.is_none());
    }
}
