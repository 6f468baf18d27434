//! Where the time of an iteration goes.

use std::{collections::BTreeMap, time::Instant};

use erfgs_splat::gpu::{Gpu, GpuError, Traffic};

/// Seconds and calls of every stage, if they are asked for. Measuring waits for the device after every stage, which the
/// training loop does not do otherwise.
#[derive(Debug, Default)]
pub struct StageTimes {
    last: Option<Instant>,
    counts: bool,
    stages: BTreeMap<&'static str, (f64, u64)>,
    /// What passed to and from the device in the iterations that were counted.
    pub traffic: Traffic,
    /// The most of each that passed in one of them.
    pub most: Traffic,
}

impl StageTimes {
    /// Starts to count what passes.
    pub fn count(&mut self) {
        self.counts = true;
    }

    /// Starts to measure, and counts no more: each stage is waited for, and handed to the device by itself.
    pub fn start(&mut self) {
        (self.last, self.counts) = (Some(Instant::now()), false);
    }

    /// Whether the end of each stage is waited for.
    pub(super) fn waits(&self) -> bool {
        self.last.is_some()
    }

    /// Ends the stage `name`, which began where the one before ended.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn lap(&mut self, gpu: &Gpu, name: &'static str) -> Result<(), GpuError> {
        let Some(last) = self.last else { return Ok(()) };
        gpu.wait(name)?;
        let now = Instant::now();
        let stage = self.stages.entry(name).or_default();
        stage.0 += (now - last).as_secs_f64();
        stage.1 += 1;
        self.last = Some(now);
        Ok(())
    }

    /// Adds what passed in an iteration.
    pub(super) fn passed(&mut self, traffic: Traffic) {
        if self.counts {
            self.traffic += traffic;
            self.most = self.most.max(traffic);
        }
    }

    /// Name, seconds and calls of every stage.
    pub fn stages(&self) -> impl Iterator<Item = (&'static str, f64, u64)> + '_ {
        self.stages.iter().map(|(name, (seconds, calls))| (*name, *seconds, *calls))
    }
}
