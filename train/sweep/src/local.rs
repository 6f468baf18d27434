//! The jobs of a sweep on this machine, so many at a time.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::{
        Condvar, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use super::{
    SweepError,
    manifest::{Job, Manifest},
    status::{JobState, Overview, Queue},
    work::{Ended, work},
};

/// How often somebody is told how far it is.
const TOLD_EVERY: Duration = Duration::from_secs(1);
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// What a worker does next.
enum Next<'a> {
    Job(&'a Job),
    /// What others work on must be done before.
    Wait,
    Nothing,
}

/// Works on all jobs that are not done, `at_once` at a time, until they are or `stop` is set. `progress` is told where they
/// stand. A job that fails costs its own run only.
///
/// # Errors
/// [`SweepError`] if the sweep's own files cannot be written.
pub fn run(
    manifest: &Manifest,
    program: &Path,
    at_once: usize,
    stop: &AtomicBool,
    mut progress: impl FnMut(&Overview),
) -> Result<Overview, SweepError> {
    let waiting: Vec<&Job> = manifest.jobs.iter().filter(|job| !manifest.is_done(job)).collect();
    let workers = at_once.clamp(1, waiting.len().max(1));
    let waiting = Mutex::new(waiting);
    let now: Mutex<Queue> = Mutex::new(BTreeMap::new());
    let ended_one = Condvar::new();
    let queue = || now.lock().unwrap_or_else(PoisonError::into_inner);
    let next = || {
        let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let mut running = queue();
        // Done is asked after running: a job that ends meanwhile is one of both.
        let may_become_ready = |job: &&Job| job.after.as_ref().is_some_and(|name| running.contains_key(name));
        let wait = waiting.iter().any(may_become_ready);
        match waiting.iter().position(|job| manifest.is_ready(job)) {
            Some(at) => {
                let job = waiting.remove(at);
                running.insert(job.name.clone(), JobState::Running);
                Next::Job(job)
            }
            None if wait => Next::Wait,
            // What is left waits for what failed.
            None => Next::Nothing,
        }
    };
    let worker = || -> Result<(), SweepError> {
        while !stop.load(Ordering::Relaxed) {
            let job = match next() {
                Next::Job(job) => job,
                Next::Wait => {
                    // Whoever wants all of it to stop tells nobody.
                    drop(ended_one.wait_timeout(queue(), LOOK_EVERY));
                    continue;
                }
                Next::Nothing => break,
            };
            let ended = work(manifest, job, program, stop);
            queue().remove(&job.name);
            ended_one.notify_all();
            if ended? == Ended::Stopped {
                break;
            }
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(worker)).collect();
        let mut looks = 0;
        while workers.iter().any(|worker| !worker.is_finished()) {
            if looks % (TOLD_EVERY.as_millis() / LOOK_EVERY.as_millis()) == 0 {
                let queue = now.lock().unwrap_or_else(PoisonError::into_inner).clone();
                progress(&Overview::of(manifest, &queue));
            }
            looks += 1;
            std::thread::sleep(LOOK_EVERY);
        }
        for worker in workers {
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        }
        Ok(Overview::of(manifest, &Queue::new()))
    })
}
