//! What a run tells its caller.

use crate::{
    checkpoint::CheckpointError,
    config::ConfigError,
    feed::FeedError,
    metrics::MetricError,
    scene::SceneError,
    schedule::{Budget, Stage},
};
use erfgs_run::RunError;
use erfgs_splat::{field::FieldError, gpu::GpuError, model::ModelError, raster::RasterError};
use serde::Serialize;

use super::Trainer;

/// How a run is driven.
#[derive(Clone, Copy, Debug, Default)]
pub struct TrainOptions {
    /// How long training may take; its schedule then follows the clock.
    pub budget: Budget,
    /// Whether to look at held-out cameras during training.
    pub evaluate: bool,
    /// Whether checkpoints leave out how long training took, so that the same run writes the same bytes.
    pub deterministic: bool,
    /// Bytes of the device's memory that frames and events may take; a quarter of it where nothing is said, or of what is free where the
    /// device shares the processor's. What does not fit is handed over when it is looked at, and teaches the same.
    pub device_memory: Option<u64>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The schedule is over.
    Finished,
    /// It was asked to stop; its checkpoint resumes it.
    Stopped,
}

/// Where a run stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Progress {
    /// Which of the two stages it is in.
    pub stage: Stage,
    /// Iterations done, over both stages.
    pub iteration: u64,
    /// Iterations of both stages.
    pub iterations: u64,
    /// How much is done, 0 to 1, by iterations or by the clock.
    pub share: f64,
    /// Seconds of training so far, without evaluation.
    pub seconds: f64,
    /// CPU seconds of training so far, likewise; 0 where the system does not tell.
    pub cpu_seconds: f64,
    /// Gaussians, those that never move included.
    pub gaussians: u32,
    /// Gaussians that the field deforms.
    pub dynamic: u32,
    /// Mean photometric loss since the last row of the curve, at such a row.
    pub loss_rgb: Option<f64>,
    /// Mean event loss, likewise.
    pub loss_event: Option<f64>,
    /// PSNR on held-out cameras, at an evaluation.
    pub psnr: Option<f64>,
    /// PSNR on moving pixels of held-out cameras, at an evaluation.
    pub dpsnr: Option<f64>,
}

/// Who follows a run. A closure that takes [`Progress`] is one that looks at nothing else.
pub trait Watch {
    /// Told after every iteration.
    fn progress(&mut self, now: &Progress);

    /// Asked after every iteration: whether training is to pause for [`Self::look`].
    fn wants_look(&mut self) -> bool {
        false
    }

    /// Looks at what was learned. The time that this takes is no training time.
    ///
    /// # Errors
    /// [`TrainError`] where the device fails; it ends the run.
    fn look(&mut self, trainer: &mut Trainer<'_>) -> Result<(), TrainError> {
        let _ = trainer;
        Ok(())
    }

    /// Asked after every iteration: whether a checkpoint is to be saved now.
    fn wants_checkpoint(&mut self) -> bool {
        false
    }
}

impl<F: FnMut(&Progress)> Watch for F {
    fn progress(&mut self, now: &Progress) {
        self(now);
    }
}

/// Why a run ended early.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The checkpoint is of other cameras.
    #[error(
        "the checkpoint has {what} of {saved} cameras, but the dataset has {views} cameras; resume with the dataset that the run began with"
    )]
    Cameras {
        /// What is learned of them.
        what: &'static str,
        /// Cameras of the checkpoint.
        saved: usize,
        /// Cameras of the dataset.
        views: usize,
    },
    /// A static set cannot be trained with so.
    #[error("a static set cannot be taken over: {reason}")]
    StaticSet {
        /// Why.
        reason: String,
    },
    /// The run was trained with other event cameras.
    #[error(
        "the checkpoint has levels of {saved} event pixels, but the dataset has {pixels}, or sensors of other sizes; resume with the dataset that the run began with"
    )]
    Levels {
        /// Pixels of event cameras in the checkpoint.
        saved: usize,
        /// Pixels of the event cameras of the dataset.
        pixels: usize,
    },
    /// A number stopped being one.
    #[error(
        "training diverged at iteration {iteration}: the {what} are no longer finite; the last checkpoint is kept. Resume from it with a lower learning rate, for example `--resume --change --set {lower}`"
    )]
    Diverged {
        /// Which quantity.
        what: String,
        /// When.
        iteration: u64,
        /// The learning rate that moves it, half as high.
        lower: String,
    },
    /// Nothing is left that could learn.
    #[error(
        "training diverged at iteration {iteration}: no Gaussian is visible in any picture any more (loss {loss:.3}), so that \
         nothing can be learned. Train with lower learning rates, for example `--set {lower}`; if nothing was ever visible, check the \
         poses, the initial points and near_m"
    )]
    Vanished {
        /// When.
        iteration: u64,
        /// The mean photometric loss.
        loss: f64,
        /// The learning rate of sizes, half as high.
        lower: String,
    },
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The dataset.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The rasteriser.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// The field.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// The run folder.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A metric.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// An exported file.
    #[error(transparent)]
    Export(#[from] erfgs_scene::ply::GaussianCloudError),
    /// A picture.
    #[error(transparent)]
    Image(#[from] erfgs_scene::image::ImageError),
}

impl From<FeedError> for TrainError {
    fn from(error: FeedError) -> Self {
        match error {
            FeedError::Scene(error) => error.into(),
            FeedError::Gpu(error) => error.into(),
        }
    }
}

impl From<ModelError> for TrainError {
    fn from(error: ModelError) -> Self {
        match error {
            ModelError::Gpu(error) => error.into(),
            ModelError::Raster(error) => error.into(),
            ModelError::Field(error) => error.into(),
        }
    }
}
