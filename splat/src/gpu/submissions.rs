//! When recordings are handed to the device: one by one, or several at once.

use std::{
    marker::PhantomData,
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError},
    thread::{self, ThreadId},
};

use super::Gpu;

/// The submission that a recording goes with, which is known once that was handed over.
#[derive(Clone, Debug, Default)]
pub struct Submission(Arc<OnceLock<wgpu::SubmissionIndex>>);

/// What waits to be handed over; nothing while recordings are handed over one by one.
#[derive(Debug, Default)]
pub(super) struct Held(Mutex<Option<Waiting>>);

/// Recordings of one thread in the order in which they run.
#[derive(Debug)]
struct Waiting {
    thread: ThreadId,
    recordings: Vec<wgpu::CommandBuffer>,
    submission: Submission,
}

/// While this lives, what its thread records waits to be handed over at once; see [`Gpu::hold_back`].
#[derive(Debug)]
#[must_use = "recordings wait only while it lives"]
pub struct HeldBack<'a> {
    gpu: &'a Gpu,
    // It ends on the thread that it is for.
    stays: PhantomData<*const ()>,
}

impl Gpu {
    /// From now on what this thread records waits until [`Gpu::flush`], or until its results are read, waited for or written over by the
    /// host: a submission takes the host and the device as long as many dispatches. The order in which all of it runs stays the same.
    /// Other threads' recordings are handed over as ever.
    pub fn hold_back(&self) -> HeldBack<'_> {
        self.flush();
        let thread = thread::current().id();
        let waiting = Waiting { thread, recordings: Vec::new(), submission: Submission::default() };
        self.held.lock().get_or_insert(waiting);
        HeldBack { gpu: self, stays: PhantomData }
    }

    /// Hands over what this thread has held back.
    pub fn flush(&self) {
        let mut held = self.held.lock();
        let Some(waiting) = held.as_mut().filter(|waiting| waiting.is_mine()) else { return };
        if waiting.recordings.is_empty() {
            return;
        }
        let (recordings, submission) =
            (std::mem::take(&mut waiting.recordings), std::mem::take(&mut waiting.submission));
        self.submit(recordings, &submission);
    }

    /// Hands a recording over, after those before it, or has it wait with them.
    pub(super) fn hand_over(&self, recording: wgpu::CommandBuffer) -> Submission {
        if let Some(waiting) = self.held.lock().as_mut().filter(|waiting| waiting.is_mine()) {
            waiting.recordings.push(recording);
            return waiting.submission.clone();
        }
        let submission = Submission::default();
        self.submit(vec![recording], &submission);
        submission
    }

    /// The submission, which has been handed over afterwards.
    pub(super) fn handed_over(&self, submission: &Submission) -> Option<wgpu::SubmissionIndex> {
        if submission.0.get().is_none() {
            self.flush();
        }
        submission.0.get().cloned()
    }

    fn submit(&self, recordings: Vec<wgpu::CommandBuffer>, submission: &Submission) {
        self.counters.submitted();
        // Each is handed over once.
        let _ = submission.0.set(self.queue.submit(recordings));
    }
}

impl Held {
    fn lock(&self) -> MutexGuard<'_, Option<Waiting>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Waiting {
    fn is_mine(&self) -> bool {
        self.thread == thread::current().id()
    }
}

impl Drop for HeldBack<'_> {
    fn drop(&mut self) {
        self.gpu.flush();
        let mut held = self.gpu.held.lock();
        if held.as_ref().is_some_and(Waiting::is_mine) {
            *held = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{AdapterChoice, Kernel};

    /// Adds `by` to the first number of `sums`, after doubling it.
    const DOUBLE_AND_ADD: &str = "
        @group(0) @binding(0) var<storage, read> by: array<u32>;
        @group(0) @binding(1) var<storage, read_write> sums: array<u32>;
        @compute @workgroup_size(1) fn main() { sums[0] = 2u * sums[0] + by[0]; }";

    fn record(gpu: &Gpu, kernel: &Kernel, by: &wgpu::Buffer, sums: &wgpu::Buffer) -> Submission {
        let mut commands = gpu.commands();
        commands.dispatch(kernel, &[by, sums], 1);
        commands.submit()
    }

    #[test]
    fn what_is_held_back_runs_in_order_and_at_once() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        let kernel = gpu.kernel("double and add", &[DOUBLE_AND_ADD]);
        let number = |value: u32| gpu.storage_from("number", &[value]).expect("room");
        let (sums, one, two) = (number(1), number(1), number(2));
        let submissions = |before: u64| gpu.traffic().submissions - before;
        let before = gpu.traffic().submissions;
        let held = gpu.hold_back();
        let submission = record(&gpu, &kernel, &one, &sums);
        record(&gpu, &kernel, &two, &sums);
        // A new buffer hands nothing over.
        let three = number(3);
        record(&gpu, &kernel, &three, &sums);
        assert_eq!((submissions(before), submission.0.get().is_some()), (0, false));
        gpu.flush();
        assert_eq!((submissions(before), submission.0.get().is_some()), (1, true));
        gpu.flush();
        assert_eq!(submissions(before), 1, "nothing waits");
        // What is read was computed; on an adapter that is not mapped in place, the copy goes along.
        record(&gpu, &kernel, &one, &sums);
        assert_eq!(gpu.download::<u32>(&sums, 1).expect("a number"), [2 * (2 * (2 * (2 + 1) + 2) + 3) + 1]);
        assert_eq!(submissions(before), 2);
        drop(held);
        record(&gpu, &kernel, &one, &sums);
        assert_eq!(submissions(before), 3, "one by one again");
    }

    #[test]
    fn what_the_host_writes_does_not_overtake_what_is_held_back() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        let kernel = gpu.kernel("double and add", &[DOUBLE_AND_ADD]);
        let [by, sums] = [5_u32, 0].map(|value| gpu.storage_from("number", &[value]).expect("room"));
        let held = gpu.hold_back();
        record(&gpu, &kernel, &by, &sums);
        gpu.upload(&by, 0, &[7_u32]);
        record(&gpu, &kernel, &by, &sums);
        drop(held);
        assert_eq!(gpu.download::<u32>(&sums, 1).expect("a number"), [2 * 5 + 7]);
    }

    #[test]
    fn what_other_threads_record_is_not_held_back() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        let kernel = gpu.kernel("double and add", &[DOUBLE_AND_ADD]);
        let [by, mine, theirs] = [5_u32, 1, 2].map(|value| gpu.storage_from("number", &[value]).expect("room"));
        let held = gpu.hold_back();
        let before = gpu.traffic().submissions;
        record(&gpu, &kernel, &by, &mine);
        thread::scope(|scope| scope.spawn(|| record(&gpu, &kernel, &by, &theirs)).join()).expect("a thread");
        assert_eq!(gpu.traffic().submissions - before, 1);
        gpu.wait("adding").expect("a device");
        assert_eq!(gpu.traffic().submissions - before, 2);
        drop(held);
        let sums = [&mine, &theirs].map(|sums| gpu.download::<u32>(sums, 1).expect("a number")[0]);
        assert_eq!(sums, [2 + 5, 4 + 5]);
    }
}
