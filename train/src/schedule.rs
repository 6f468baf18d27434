//! What happens at which iteration.

use serde::{Deserialize, Serialize};

use crate::config::Config;

/// The two stages of 4DGS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// One static scene for all times.
    Coarse,
    /// With the deformation field.
    Fine,
}

impl Stage {
    /// Its name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Coarse => "coarse",
            Self::Fine => "fine",
        }
    }
}

/// Where a run stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// Which of the two stages it is in.
    pub stage: Stage,
    /// Iterations of the stage that are done.
    pub iteration: u32,
    /// Iterations that the coarse stage took, once it is over.
    pub coarse: u32,
    /// Seconds of training so far, without evaluation.
    pub seconds: f64,
    /// Seconds of training at which the stage began.
    pub stage_start: f64,
    /// CPU seconds of training so far, without evaluation; 0 where the system does not tell.
    #[serde(default)]
    pub cpu_seconds: f64,
    /// CPU seconds of training at which the stage began.
    #[serde(default)]
    pub stage_start_cpu: f64,
    /// Seconds and CPU seconds of these that a trial took before the training ([`crate::trial`]).
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub trial: [f64; 2],
    /// How often the part of the recording that bodies are followed in has grown.
    #[serde(default, skip_serializing_if = "is_none")]
    pub followed: u32,
}

fn is_none(followed: &u32) -> bool {
    *followed == 0
}

fn is_nothing(trial: &[f64; 2]) -> bool {
    *trial == [0.0; 2]
}

impl Clock {
    /// The clock of a training that begins after a trial that took so long, seconds and CPU seconds.
    #[must_use]
    pub fn after(trial: [f64; 2]) -> Self {
        let [seconds, cpu_seconds] = trial;
        Self { seconds, stage_start: seconds, cpu_seconds, stage_start_cpu: cpu_seconds, trial, ..Self::default() }
    }
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            stage: Stage::Coarse,
            iteration: 0,
            coarse: 0,
            seconds: 0.0,
            stage_start: 0.0,
            cpu_seconds: 0.0,
            stage_start_cpu: 0.0,
            trial: [0.0; 2],
            followed: 0,
        }
    }
}

/// How long a run may take, both stages together, which share it as they share the iterations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Budget {
    /// Seconds of training.
    pub seconds: Option<f64>,
    /// CPU seconds of training, over all threads.
    pub cpu_seconds: Option<f64>,
}

impl Budget {
    /// Whether there is none.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.seconds.is_none() && self.cpu_seconds.is_none()
    }
}

/// How long a run lasts: by iterations, and by the clock where a budget is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// Iterations of the stages.
    pub iterations: [u32; 2],
    /// How long it may take.
    pub budget: Budget,
}

impl Schedule {
    /// The schedule of `config` within a budget.
    #[must_use]
    pub fn new(config: &Config, budget: Budget) -> Self {
        Self { iterations: [config.coarse_iterations, config.fine_iterations], budget }
    }

    /// Iterations of a stage.
    #[must_use]
    pub fn length(&self, stage: Stage) -> u32 {
        self.iterations[stage as usize]
    }

    /// Iterations done so far, over both stages.
    #[must_use]
    pub fn done(&self, clock: &Clock) -> u64 {
        u64::from(clock.coarse) + u64::from(clock.iteration)
    }

    /// How far the stage is, 0 to 1: by iterations, by the clock or by CPU time, whichever is further. Learning rates and
    /// densification follow it, so that a run with a budget anneals within it.
    #[must_use]
    pub fn progress(&self, clock: &Clock) -> f64 {
        let length = self.length(clock.stage);
        if length == 0 {
            return 1.0;
        }
        let by_iteration = f64::from(clock.iteration) / f64::from(length);
        let total = f64::from(self.iterations[0]) + f64::from(self.iterations[1]);
        let share = f64::from(self.length(clock.stage)) / total.max(1.0);
        let spent = |budget: Option<f64>, trial: f64, seconds: f64| {
            budget.map_or(0.0, |budget| seconds / ((budget - trial) * share).max(1e-9))
        };
        let by_clock = spent(self.budget.seconds, clock.trial[0], clock.seconds - clock.stage_start);
        let by_cpu = spent(self.budget.cpu_seconds, clock.trial[1], clock.cpu_seconds - clock.stage_start_cpu);
        by_iteration.max(by_clock).max(by_cpu).min(1.0)
    }

    /// Whether the stage is over.
    #[must_use]
    pub fn is_over(&self, clock: &Clock) -> bool {
        self.progress(clock) >= 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_without_iterations_is_over_at_once() {
        let schedule = Schedule { iterations: [5, 0], budget: Budget::default() };
        assert!(!schedule.is_over(&Clock::default()));
        assert!(schedule.is_over(&Clock { stage: Stage::Fine, ..Clock::default() }));
    }

    #[test]
    fn a_budget_ends_a_stage_early_and_each_stage_gets_its_share() {
        let budget = Budget { seconds: Some(100.0), cpu_seconds: Some(150.0) };
        let schedule = Schedule { iterations: [1000, 3000], budget };
        let mut clock = Clock { iteration: 10, seconds: 12.5, ..Clock::default() };
        assert!((schedule.progress(&clock) - 0.5).abs() < 1e-12);
        clock.seconds = 25.0;
        assert!(schedule.is_over(&clock));
        let fine = Clock { stage: Stage::Fine, iteration: 3000, coarse: 200, seconds: 30.0, ..clock };
        assert!(schedule.is_over(&fine), "iterations end a stage too");
        assert_eq!(schedule.done(&fine), 3200, "the coarse stage ended early");
        let busy = Clock { cpu_seconds: 150.0 * 0.25, ..Clock::default() };
        assert!(schedule.is_over(&busy), "CPU time ends a stage too");
    }
}
