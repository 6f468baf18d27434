//! Learning when the training cameras took their frames, and when event cameras saw what they recorded.

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
    /// Whether the times of frames are learned.
    pub of_frames: bool,
}

impl Clocks {
    /// As the frames say; nothing where clocks are not to be learned, nothing moves in a way that tells them, or too few cameras take
    /// frames.
    pub fn new(gpu: &Gpu, scene: &Scene, config: &Config) -> Result<Option<Self>, TrainError> {
        let intervals = scene.intervals();
        let interval_s = interval_s(scene, intervals);
        let cameras = scene.dataset.manifest.cameras.iter().enumerate();
        let learner = |(camera, of): (usize, &Camera)| Learner {
            camera,
            sigma: of.clock_sigma_s.map(|s| s / interval_s),
            dates: scene.has_frames(camera),
        };
        let options = &config.camera_time;
        let all: Vec<Learner> = cameras.map(learner).collect();
        let of_frames = all.iter().filter(|learner| learner.dates).count() >= options.fewest as usize;
        // A device with both has one clock, which its frames tell.
        let of_events = |learner: &Learner| {
            let has_events = scene.events.iter().any(|events| events.view == learner.camera);
            options.events && config.earl.enabled && !learner.dates && has_events
        };
        let learns = |learner: &Learner| if learner.dates { of_frames } else { of_events(learner) };
        let learners: Vec<Learner> = all.into_iter().filter(learns).collect();
        let determined = options.enabled
            && matches!(config.motion, MotionModel::FreeTime | MotionModel::Bodies)
            && scene.frame_times.len() > 1;
        if !determined || learners.is_empty() {
            return Ok(None);
        }
        let learning = Learning::new(gpu, "gradients of clocks", scene.views.len(), learners)?;
        Ok(Some(Self { learning, labelled: scene.frames.clone(), intervals, of_frames }))
    }

    /// Where the gradient of a camera's time is added, where that is learned.
    pub fn row(&self, camera: usize) -> Option<ClockRow<'_>> {
        let learns = self.learning.learners.iter().any(|learner| learner.camera == camera);
        learns.then_some(ClockRow { sums: &self.learning.sums, row: camera as u32 })
    }

    /// By how much later a camera recorded than its frames or events say, of the recording.
    fn late(&self, camera: usize) -> f64 {
        f64::from(self.learning.state.values[camera]) / self.intervals
    }

    /// What a checkpoint keeps.
    pub fn saved(&self, gpu: &Gpu) -> Result<CameraTimeState, TrainError> {
        self.learning.saved(gpu)
    }

    /// How much later the cameras recorded than their frames or events say.
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
            let late = self.late(frame.view);
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

    /// When the scene was as the events of a camera say that it is at a time, both in [0, 1] of the recording.
    pub(super) fn seen_at(&self, camera: usize, time: f64) -> f64 {
        // The events of a camera with frames are as they are labelled.
        let learned = self.clocks.as_ref().filter(|_| !self.scene.has_frames(camera));
        time + learned.map_or(0.0, |clocks| clocks.late(camera))
    }

    /// Whether the events of a camera tell its clock by now; those of a camera with frames do not.
    pub(super) fn events_tell_clock(&self, camera: usize) -> bool {
        !self.scene.has_frames(camera) && self.config.camera_time.due(self.share())
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
