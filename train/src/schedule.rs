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
}

impl Default for Clock {
    fn default() -> Self {
        Self { stage: Stage::Coarse, iteration: 0, coarse: 0, seconds: 0.0, stage_start: 0.0 }
    }
}

/// How long a run lasts: by iterations, and by the clock where a budget is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// Iterations of the stages.
    pub iterations: [u32; 2],
    /// Seconds of training for both stages together; they share it as they share the iterations.
    pub budget_seconds: Option<f64>,
}

impl Schedule {
    /// The schedule of `config` within a budget.
    #[must_use]
    pub fn new(config: &Config, budget_seconds: Option<f64>) -> Self {
        Self { iterations: [config.coarse_iterations, config.fine_iterations], budget_seconds }
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

    /// How far the stage is, 0 to 1: by iterations or by the clock, whichever is further. Learning rates and
    /// densification follow it, so that a run with a budget anneals within it.
    #[must_use]
    pub fn progress(&self, clock: &Clock) -> f64 {
        let by_iteration = f64::from(clock.iteration) / f64::from(self.length(clock.stage).max(1));
        let by_clock = self.budget_seconds.map_or(0.0, |budget| {
            let total = f64::from(self.iterations[0]) + f64::from(self.iterations[1]);
            let share = f64::from(self.length(clock.stage)) / total.max(1.0);
            (clock.seconds - clock.stage_start) / (budget * share).max(1e-9)
        });
        by_iteration.max(by_clock).min(1.0)
    }

    /// Whether the stage is over.
    #[must_use]
    pub fn is_over(&self, clock: &Clock) -> bool {
        self.progress(clock) >= 1.0
    }
}

/// A learning rate that falls exponentially from the first to the last value.
#[must_use]
pub fn decayed(rate: [f32; 2], progress: f64) -> f32 {
    let (first, last) = (f64::from(rate[0]), f64::from(rate[1]));
    if first <= 0.0 || last <= 0.0 {
        return (first + (last - first) * progress) as f32;
    }
    (first * (last / first).powf(progress.clamp(0.0, 1.0))) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_falls_evenly_in_its_logarithm() {
        assert!((decayed([1e-2, 1e-4], 0.5) - 1e-3).abs() < 1e-9);
        assert_eq!(decayed([1e-2, 1e-4], 2.0), 1e-4);
    }

    #[test]
    fn a_budget_ends_a_stage_early_and_each_stage_gets_its_share() {
        let schedule = Schedule { iterations: [1000, 3000], budget_seconds: Some(100.0) };
        let mut clock = Clock { iteration: 10, seconds: 12.5, ..Clock::default() };
        assert!((schedule.progress(&clock) - 0.5).abs() < 1e-12);
        clock.seconds = 25.0;
        assert!(schedule.is_over(&clock));
        let fine = Clock { stage: Stage::Fine, iteration: 3000, coarse: 200, seconds: 30.0, stage_start: 25.0 };
        assert!(schedule.is_over(&fine), "iterations end a stage too");
        assert_eq!(schedule.done(&fine), 3200, "the coarse stage ended early");
    }
}
