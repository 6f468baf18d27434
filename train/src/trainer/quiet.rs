//! A training of which nothing is written.

use super::{TrainError, Trainer, training::Lap};
use crate::{scene::Scene, schedule::Stage};

/// The device is waited for after so many iterations, so that whoever asks hears where it stands.
const WAIT_EVERY: u32 = 20;

impl Trainer<'_> {
    /// Trains until the end of a stage; `go_on` is asked every so often. Whether it came to the end.
    pub(crate) fn train_quietly(
        &mut self,
        until: Stage,
        go_on: &mut dyn FnMut(&Self) -> bool,
    ) -> Result<bool, TrainError> {
        let lap = Lap::begin(&self.clock);
        loop {
            while self.schedule.is_over(&self.clock) {
                if self.clock.stage == until {
                    self.end_following()?;
                    self.gpu.wait("training")?;
                    self.check_finite()?;
                    return Ok(true);
                }
                self.begin_fine()?;
            }
            self.iterate()?;
            self.control_density()?;
            lap.tell(&mut self.clock);
            if self.clock.iteration.is_multiple_of(WAIT_EVERY) {
                self.gpu.wait("training")?;
                if !go_on(self) {
                    return Ok(false);
                }
            }
        }
    }

    /// What it trained on.
    pub(crate) fn into_scene(self) -> Scene {
        self.scene
    }
}
