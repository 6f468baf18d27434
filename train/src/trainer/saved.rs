//! What is kept of a training, and a training that goes on from it.

use super::{TrainError, TrainOptions, Trainer};
use crate::{
    checkpoint::Checkpoint,
    scene::Scene,
    schedule::{Clock, Stage},
};
use erfgs_splat::gpu::Gpu;

impl<'a> Trainer<'a> {
    /// A run that goes on from a checkpoint.
    ///
    /// # Errors
    /// [`TrainError::Field`] where the checkpoint's field does not fit the configuration.
    pub fn resume(
        gpu: &'a Gpu,
        scene: Scene,
        checkpoint: Checkpoint,
        options: &TrainOptions,
    ) -> Result<Self, TrainError> {
        let Checkpoint { config, clock, step, population, field_box, field, statistics, levels, left_out, .. } =
            checkpoint;
        let (camera_colours, camera_poses) = (checkpoint.camera_colours, checkpoint.camera_poses);
        let fixed = checkpoint.fixed as u32;
        let camera_times = checkpoint.camera_times;
        let mut trainer = Self::assemble(gpu, scene, config, options, &population, clock, &levels)?;
        trainer.model.fixed = fixed;
        trainer.restore_poses(camera_poses)?;
        trainer.find_regions()?;
        if clock.stage == Stage::Fine {
            trainer.model.start_motion(gpu, &trainer.config, &trainer.scene, field_box)?;
            if let Some(motion) = &mut trainer.model.drawn.motion {
                motion.restore(gpu, field.as_ref())?;
            }
            trainer.start_following();
        }
        // After all that is found from the frames as the dataset has them, as in a run that was not stopped.
        trainer.restore_clocks(camera_times)?;
        trainer.model.step = step;
        trainer.statistics.replace(gpu, &statistics)?;
        if let Some(state) = camera_colours.as_ref().filter(|_| trainer.colours_differ) {
            let (saved, views) = (state.steps.len(), trainer.scene.views.len());
            if saved != views {
                return Err(TrainError::Cameras { what: "colours", saved, views });
            }
            trainer.colours.restore(gpu, state);
        }
        trainer.left_out = left_out;
        if let Some(sums) = &checkpoint.loss_sums {
            trainer.work.sums.restore(gpu, sums);
        }
        Ok(trainer)
    }

    /// Everything that the run needs to go on.
    ///
    /// # Errors
    /// [`TrainError::Gpu`] where the device fails.
    pub fn checkpoint(&self) -> Result<Checkpoint, TrainError> {
        let Clock { stage, iteration, coarse, followed, .. } = self.clock;
        let timeless = Clock { stage, iteration, coarse, followed, ..Clock::default() };
        let field = self.field()?;
        Ok(Checkpoint {
            config: self.config.clone(),
            clock: if self.deterministic { timeless } else { self.clock },
            step: self.model.step,
            population: self.model.population(self.gpu)?,
            fixed: self.model.fixed as usize,
            field_box: self.model.field_box,
            record: Some(self.record(field.as_ref())?),
            points: self.initial_points(),
            field,
            statistics: self.statistics.read(self.gpu)?,
            camera_colours: match self.colours_differ {
                true => Some(self.colour_state()?),
                false => None,
            },
            camera_poses: self.poses.as_ref().map(|poses| poses.saved(self.gpu)).transpose()?,
            camera_times: self.clocks.as_ref().map(|clocks| clocks.saved(self.gpu)).transpose()?,
            levels: self.levels.iter().map(|levels| levels.read(self.gpu)).collect::<Result<_, _>>()?,
            loss_sums: self.work.sums.state(self.gpu)?,
            left_out: self.left_out.clone(),
        })
    }
}
