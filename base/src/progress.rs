//! Long jobs: how far they have come, and their work on all cores.

use std::sync::{
    atomic::{AtomicBool, Ordering},
    mpsc,
};

use rayon::prelude::*;

/// What a long job reports while it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is counted, for example `frames`.
    pub what: &'static str,
    /// How many are done.
    pub done: u64,
    /// How many there are in all; 0 while that is unknown.
    pub total: u64,
}

/// Works on all `tasks` in parallel, with `jobs` threads or one for each core, and returns the results in order.
///
/// `work` calls its second argument once for each thing done, of which there are `total`; `progress` hears of it on the
/// calling thread. After an error no new task is begun.
///
/// # Errors
/// The first error in the order of the tasks.
pub fn in_parallel<T: Sync, R: Send, E: Send>(
    jobs: Option<usize>,
    tasks: &[T],
    (what, total): (&'static str, u64),
    work: impl Fn(&T, &dyn Fn()) -> Result<R, E> + Sync,
    progress: &mut dyn FnMut(Progress),
) -> Result<Vec<R>, E> {
    let (sender, receiver) = mpsc::channel();
    let stop = AtomicBool::new(false);
    let one = |sender: &mut mpsc::Sender<()>, task: &T| {
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        let result = work(task, &|| {
            // The receiver lives until all senders are gone, so that sending succeeds.
            let _ = sender.send(());
        });
        stop.fetch_or(result.is_err(), Ordering::Relaxed);
        Some(result)
    };
    let all = move || tasks.par_iter().map_with(sender, one).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs.unwrap_or(0)).build();
    let results: Vec<_> = std::thread::scope(|scope| {
        let worker = scope.spawn(move || match pool {
            Ok(pool) => pool.install(all),
            Err(error) => {
                tracing::warn!(%error, "no threads of its own for this job; using the shared ones");
                all()
            }
        });
        for (done, ()) in receiver.iter().enumerate() {
            progress(Progress { what, done: done as u64 + 1, total });
        }
        worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    });
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_keep_their_order_and_every_step_is_heard() {
        let tasks: Vec<u64> = (0..100).collect();
        for jobs in [None, Some(1), Some(3)] {
            let mut heard = Vec::new();
            let work = |task: &u64, tick: &dyn Fn()| {
                tick();
                Ok::<_, ()>(task * 2)
            };
            let results = in_parallel(jobs, &tasks, ("tasks", 100), work, &mut |p| heard.push(p.done)).unwrap();
            assert!(results.iter().eq((0..200).step_by(2).collect::<Vec<_>>().iter()));
            assert_eq!(heard, (1..=100).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_first_error_is_returned_and_later_tasks_are_not_begun() {
        let begun = std::sync::atomic::AtomicUsize::new(0);
        let tasks: Vec<usize> = (0..1000).collect();
        let work = |task: &usize, _: &dyn Fn()| {
            begun.fetch_add(1, Ordering::Relaxed);
            if *task >= 10 { Err(*task) } else { Ok(()) }
        };
        let error = in_parallel(Some(1), &tasks, ("tasks", 1000), work, &mut |_| {}).unwrap_err();
        assert_eq!((error, begun.load(Ordering::Relaxed)), (10, 11));
    }
}
