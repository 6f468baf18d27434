//! Learning when the training cameras took their frames.

use erfgs_dataset::Camera;
use erfgs_run::CameraTime;

use super::{TrainError, Trainer, summed::Learning};
use crate::{
    cameras::clock::{CameraTimeState, Learner, OfClock},
    config::{Config, MotionModel},
    scene::{Scene, TrainFrame},
};
use erfgs_splat::{gpu::Gpu, motion::ClockRow};

/// The clocks that are learned.
#[derive(Debug)]
pub(super) struct Clocks {
    learning: Learning<OfClock>,
    /// The frames as the dataset has them.
    labelled: Vec<TrainFrame>,
    /// RGB intervals of the recording.
    intervals: f64,
}

impl Clocks {
    /// As the frames say; nothing where clocks are not to be learned, nothing moves in a way that tells them, or too few cameras take
    /// frames.
    pub fn new(gpu: &Gpu, scene: &Scene, config: &Config) -> Result<Option<Self>, TrainError> {
        let intervals = scene.intervals();
        let interval_s = interval_s(scene, intervals);
        let cameras = scene.dataset.manifest.cameras.iter().enumerate();
        let learner =
            |(camera, of): (usize, &Camera)| Learner { camera, sigma: of.clock_sigma_s.map(|s| s / interval_s) };
        let learners: Vec<Learner> = cameras.filter(|(camera, _)| scene.has_frames(*camera)).map(learner).collect();
        let options = &config.camera_time;
        let determined = options.enabled
            && matches!(config.motion, MotionModel::FreeTime | MotionModel::Bodies)
            && scene.frame_times.len() > 1;
        if !determined || learners.len() < options.fewest as usize {
            return Ok(None);
        }
        let learning = Learning::new(gpu, "gradients of clocks", scene.views.len(), learners)?;
        Ok(Some(Self { learning, labelled: scene.frames.clone(), intervals }))
    }

    /// Where the gradient of a camera's time is added.
    pub fn row(&self, camera: usize) -> ClockRow<'_> {
        ClockRow { sums: &self.learning.sums, row: camera as u32 }
    }

    /// What a checkpoint keeps.
    pub fn saved(&self, gpu: &Gpu) -> Result<CameraTimeState, TrainError> {
        self.learning.saved(gpu)
    }

    /// How much later the cameras took their frames than these say.
    pub fn found(&self, scene: &Scene) -> Vec<CameraTime> {
        let interval_ms = 1e3 * interval_s(scene, self.intervals);
        let one = |&Learner { camera, .. }: &Learner| CameraTime {
            camera: scene.views[camera].name.clone(),
            late_ms: interval_ms * f64::from(self.learning.state.values[camera]),
        };
        self.learning.learners.iter().map(one).collect()
    }

    fn place(&self, frames: &mut [TrainFrame]) {
        for (frame, labelled) in frames.iter_mut().zip(&self.labelled) {
            let late = f64::from(self.learning.state.values[frame.view]) / self.intervals;
            frame.t01 = labelled.t01 + late;
            frame.exposure = labelled.exposure.map(|at| at + late);
        }
    }
}

/// How long an RGB interval is, seconds, where the recording spans so many.
fn interval_s(scene: &Scene, intervals: f64) -> f64 {
    let [start, end] = scene.dataset.manifest.span_ns;
    1e-9 * (end - start) as f64 / intervals
}

impl Trainer<'_> {
    /// Takes up what clocks have learned.
    ///
    /// # Errors
    /// [`TrainError::Cameras`] where the checkpoint is of other cameras.
    pub(super) fn restore_clocks(&mut self, saved: Option<CameraTimeState>) -> Result<(), TrainError> {
        let (Some(clocks), Some(saved)) = (&mut self.clocks, saved) else { return Ok(()) };
        clocks.learning.restore(self.gpu, saved, "time offsets")?;
        clocks.place(&mut self.scene.frames);
        Ok(())
    }

    /// A step of the clocks, where one is due.
    pub(super) fn learn_clocks(&mut self) -> Result<(), TrainError> {
        let (share, done) = (self.share(), self.schedule.done(&self.clock));
        if !self.config.camera_time.due(share) {
            return Ok(());
        }
        let Some(clocks) = self.clocks.as_mut().filter(|clocks| clocks.learning.is_due(done)) else { return Ok(()) };
        clocks.learning.step(self.gpu, self.config.camera_time.rule(), share)?;
        clocks.place(&mut self.scene.frames);
        Ok(())
    }
}
