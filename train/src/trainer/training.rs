//! Training until the schedule is over.

use std::{
    sync::atomic::{AtomicBool, Ordering},
    time::Instant,
};

use super::{Outcome, Progress, TrainError, TrainOptions, Trainer, Watch};
use crate::schedule::{Clock, Stage};
use erfgs_base::cpu;
use erfgs_run::RunFolder;

/// Time that counts as training, since a moment.
pub(super) struct Lap {
    started: Instant,
    cpu_started: Option<f64>,
    before: [f64; 2],
}

impl Lap {
    pub(super) fn begin(clock: &Clock) -> Self {
        let before = [clock.seconds, clock.cpu_seconds];
        Self { started: Instant::now(), cpu_started: cpu::process_seconds(), before }
    }

    pub(super) fn tell(&self, clock: &mut Clock) {
        clock.seconds = self.before[0] + self.started.elapsed().as_secs_f64();
        if let (Some(from), Some(to)) = (self.cpu_started, cpu::process_seconds()) {
            clock.cpu_seconds = self.before[1] + to - from;
        }
    }
}

impl Trainer<'_> {
    /// Trains until the schedule is over or `stop` is set, writing `run` as it goes.
    ///
    /// # Errors
    /// [`TrainError::Diverged`] names the quantity; the last checkpoint is then still there. Where a file of the dataset cannot be read
    /// any more, what was trained until then is saved.
    pub fn run(
        &mut self,
        run: &RunFolder,
        options: &TrainOptions,
        stop: &AtomicBool,
        watch: &mut dyn Watch,
    ) -> Result<Outcome, TrainError> {
        let outcome = self.train(run, options, stop, watch);
        if let Err(TrainError::Scene(_)) = &outcome {
            self.check_finite()?;
            self.checkpoint()?.save(&run.checkpoint_file())?;
            self.write_info(run)?;
        }
        outcome
    }

    fn train(
        &mut self,
        run: &RunFolder,
        options: &TrainOptions,
        stop: &AtomicBool,
        watch: &mut dyn Watch,
    ) -> Result<Outcome, TrainError> {
        run.write_config(&self.config.to_toml()?)?;
        run.write_dataset(&self.scene.dataset.manifest)?;
        // From here on a run is there for whoever looks, and says what it is.
        self.write_info(run)?;
        let mut curve = match self.schedule.done(&self.clock) {
            0 => run.create_curve()?,
            done => run.resume_curve(done)?,
        };
        let mut lap = Lap::begin(&self.clock);
        let mut looked = self.looks();
        // What was logged before a run was stopped is in its curve.
        let mut logged = Some(self.schedule.done(&self.clock)).filter(|&done| done > 0);
        let mut saved = Instant::now();
        loop {
            while self.schedule.is_over(&self.clock) {
                match self.clock.stage {
                    Stage::Coarse => {
                        self.begin_fine()?;
                        self.write_info(run)?;
                    }
                    Stage::Fine => {
                        self.end_following()?;
                        self.gpu.wait("training")?;
                        lap.tell(&mut self.clock);
                        if logged != Some(self.schedule.done(&self.clock)) {
                            self.check_finite()?;
                            self.log(&mut curve, options.evaluate, watch)?;
                        }
                        self.checkpoint()?.save(&run.checkpoint_file())?;
                        self.write_info(run)?;
                        return Ok(Outcome::Finished);
                    }
                }
            }
            self.iterate()?;
            self.control_density()?;
            let done = self.schedule.done(&self.clock);
            let looks = self.looks();
            let (log, evaluate, save) = {
                let evaluation = &self.config.evaluation;
                let due = |every: u32| every > 0 && done.is_multiple_of(u64::from(every));
                let evaluate = options.evaluate && (due(evaluation.every) || looks > looked);
                let seconds = 60.0 * evaluation.checkpoint_minutes;
                let by_clock = seconds > 0.0 && saved.elapsed().as_secs_f32() >= seconds;
                let save = due(evaluation.checkpoint_every) || by_clock || watch.wants_checkpoint();
                (due(evaluation.log_every), evaluate, save)
            };
            looked = looks;
            let look = watch.wants_look();
            let stopping = stop.load(Ordering::Relaxed);
            let pause = log || evaluate || save || stopping || look;
            if pause {
                self.gpu.wait("training")?;
            }
            lap.tell(&mut self.clock);
            if log || evaluate {
                self.check_finite()?;
                self.log(&mut curve, evaluate, watch)?;
                logged = Some(done);
            } else {
                watch.progress(&self.progress(None, None));
            }
            if save || stopping {
                // What is kept is whole: the last checkpoint is what a run that diverged is gone on with.
                self.check_finite()?;
                self.checkpoint()?.save(&run.checkpoint_file())?;
                saved = Instant::now();
            }
            if look {
                watch.look(self)?;
            }
            if stopping {
                self.write_info(run)?;
                return Ok(Outcome::Stopped);
            }
            if pause {
                // Evaluation, saving and looking are not training.
                lap = Lap::begin(&self.clock);
            }
        }
    }

    /// How many of the evaluations that `evaluation.count` asks for are due by now. They are spread over the run
    /// geometrically, from a hundredth of it on: early on, quality changes fast.
    fn looks(&self) -> u32 {
        const FIRST: f64 = 0.01;
        let steps = f64::from(self.config.evaluation.count.max(1) - 1).max(1.0);
        let share = self.share();
        let due = |look: u32| FIRST.powf(1.0 - f64::from(look) / steps) <= share + 1e-9;
        (0..self.config.evaluation.count).take_while(|&look| due(look)).count() as u32
    }

    pub(super) fn dynamic_count(&self) -> u64 {
        if self.clock.stage == Stage::Fine { u64::from(self.model.drawn.dynamic) } else { 0 }
    }

    pub(super) fn progress(&self, psnr: Option<f64>, dpsnr: Option<f64>) -> Progress {
        Progress {
            stage: self.clock.stage,
            iteration: self.schedule.done(&self.clock),
            iterations: self.schedule.iterations.iter().map(|&n| u64::from(n)).sum(),
            share: self.share(),
            seconds: self.clock.seconds,
            cpu_seconds: self.clock.cpu_seconds,
            gaussians: self.model.drawn.gaussians.count,
            dynamic: self.dynamic_count() as u32,
            loss_rgb: None,
            loss_event: None,
            psnr,
            dpsnr,
        }
    }

    /// How much of the whole run is done, 0 to 1.
    pub(super) fn share(&self) -> f64 {
        let [coarse, fine] = self.schedule.iterations.map(f64::from);
        let total = (coarse + fine).max(1.0);
        let progress = self.schedule.progress(&self.clock);
        match self.clock.stage {
            Stage::Coarse => progress * coarse / total,
            Stage::Fine => (coarse + progress * fine) / total,
        }
    }

    /// Iterations done, over both stages.
    #[must_use]
    pub fn iterations_done(&self) -> u64 {
        self.schedule.done(&self.clock)
    }
}
