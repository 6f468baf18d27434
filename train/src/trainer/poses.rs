//! Learning where the training cameras stand.

use erfgs_dataset::Camera;
use erfgs_run::CameraPose;

use super::{TrainError, Trainer, summed::Learning};
use crate::{
    cameras::pose::{CameraPoseOptions, CameraPoseState, Learner, OfPose, learner_sigma},
    scene::{Scene, SceneView, median},
};
use erfgs_splat::{
    gpu::Gpu,
    raster::{PoseRow, View},
};

/// The poses that are learned.
pub(super) type Poses = Learning<OfPose>;

impl Poses {
    /// As the cameras were calibrated; nothing where the poses are not to be learned, or too few cameras take frames.
    pub fn find(gpu: &Gpu, scene: &Scene, options: &CameraPoseOptions) -> Result<Option<Self>, TrainError> {
        let calibrated = Self::calibrated(gpu, scene)?;
        Ok(Some(calibrated).filter(|poses| options.enabled && poses.learners.len() >= options.fewest as usize))
    }

    /// As the cameras were calibrated.
    fn calibrated(gpu: &Gpu, scene: &Scene) -> Result<Self, TrainError> {
        let cameras = scene.dataset.manifest.cameras.iter().enumerate();
        let learner = |(camera, of): (usize, &Camera)| {
            let (view, pose) = (&scene.views[camera].view, of.world_to_camera);
            let depths = scene.points.iter().map(|(point, _)| f64::from(view.to_camera(point)[2]));
            let depth = median(depths.filter(|&depth| depth > 0.0).collect()).unwrap_or_else(|| scene.extent.into());
            let focal = f64::from(view.fx);
            let sigma = of.pose_sigma.map(|sigma| learner_sigma(&sigma, &pose));
            Learner { camera, pose, focal, depth, reach: 0.25 * f64::from(view.width) / focal, sigma }
        };
        let learners: Vec<Learner> = cameras.filter(|(camera, _)| scene.has_frames(*camera)).map(learner).collect();
        Self::new(gpu, "gradients of poses", scene.views.len(), learners)
    }

    /// Where the gradient of a camera's pose is added.
    pub fn row(&self, camera: usize) -> PoseRow<'_> {
        PoseRow { sums: &self.sums, row: camera as u32 }
    }

    /// How the cameras were moved.
    pub fn found(&self, scene: &Scene) -> Vec<CameraPose> {
        let one = |learner: &Learner| CameraPose {
            camera: scene.views[learner.camera].name.clone(),
            turn_degrees: self.state.of(learner.camera)[0].to_array().map(f64::to_degrees),
            shift_m: self.state.of(learner.camera)[1].to_array(),
            moved_px: self.state.pixels(learner),
        };
        self.learners.iter().map(one).collect()
    }

    fn place(&self, views: &mut [SceneView]) {
        for learner in &self.learners {
            let view: &mut View = &mut views[learner.camera].view;
            *view = view.placed(&self.state.moved(learner.camera, &learner.pose));
        }
    }
}

impl Trainer<'_> {
    /// Takes up what poses have learned; those of a static set are what they are, whatever is asked for.
    ///
    /// # Errors
    /// [`TrainError::Cameras`] where the checkpoint is of other cameras.
    pub(super) fn restore_poses(&mut self, saved: Option<CameraPoseState>) -> Result<(), TrainError> {
        if self.config.static_set.is_some() {
            self.poses = saved.is_some().then(|| Poses::calibrated(self.gpu, &self.scene)).transpose()?;
        }
        let (Some(poses), Some(saved)) = (&mut self.poses, saved) else { return Ok(()) };
        poses.restore(self.gpu, saved, "poses")?;
        poses.place(&mut self.scene.views);
        Ok(())
    }

    /// Whether poses are learned at a `share` of the whole run: those of a static set no longer are.
    pub(super) fn learns_poses(&self, share: f64) -> bool {
        self.config.static_set.is_none() && self.config.camera_pose.due(share)
    }

    /// A step of the poses, where one is due.
    pub(super) fn learn_poses(&mut self) -> Result<(), TrainError> {
        let (share, done) = (self.share(), self.schedule.done(&self.clock));
        if !self.learns_poses(share) {
            return Ok(());
        }
        let Some(poses) = self.poses.as_mut().filter(|poses| poses.is_due(done)) else { return Ok(()) };
        poses.step(self.gpu, self.config.camera_pose.rule(), share)?;
        poses.place(&mut self.scene.views);
        Ok(())
    }
}
