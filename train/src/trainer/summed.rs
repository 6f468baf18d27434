//! What is learned of cameras from gradients that are summed on the device.

use wgpu::Buffer;

use super::TrainError;
use crate::cameras::{CameraState, Rule, Summed, take_step};
use erfgs_splat::gpu::Gpu;

/// A quantity of cameras that is learned.
#[derive(Debug)]
pub(super) struct Learning<Q: Summed> {
    pub state: CameraState<Q>,
    pub learners: Vec<Q::Learner>,
    /// Gradients of the renderings since the last step, a row a camera.
    pub sums: Buffer,
}

impl<Q: Summed> Learning<Q> {
    /// Of so many cameras, none of which has learned anything.
    pub fn new(gpu: &Gpu, label: &str, cameras: usize, learners: Vec<Q::Learner>) -> Result<Self, TrainError> {
        let state = CameraState::zero(cameras);
        let sums = gpu.storage_from(label, &state.sums)?;
        Ok(Self { state, learners, sums })
    }

    /// What a checkpoint keeps.
    pub fn saved(&self, gpu: &Gpu) -> Result<CameraState<Q>, TrainError> {
        let mut state = self.state.clone();
        state.sums = gpu.download(&self.sums, state.sums.len())?;
        Ok(state)
    }

    /// Goes on from what a checkpoint kept; `what` it is in an error.
    pub fn restore(&mut self, gpu: &Gpu, saved: CameraState<Q>, what: &'static str) -> Result<(), TrainError> {
        let [cameras, views] = [saved.steps.len(), self.state.steps.len()];
        if cameras != views {
            return Err(TrainError::Cameras { what, saved: cameras, views });
        }
        gpu.upload(&self.sums, 0, &saved.sums);
        self.state = saved;
        Ok(())
    }

    /// Whether a step is due: after as many iterations as there are cameras, so that on a device little is read back.
    pub fn is_due(&self, iterations: u64) -> bool {
        iterations.is_multiple_of(self.learners.len() as u64)
    }

    /// A step.
    pub fn step(&mut self, gpu: &Gpu, rule: Rule, share: f64) -> Result<(), TrainError> {
        let sums: Vec<f32> = gpu.download(&self.sums, self.state.sums.len())?;
        take_step(&mut self.state, &self.learners, &sums, rule, share);
        let mut commands = gpu.commands();
        commands.clear(&self.sums);
        commands.submit();
        Ok(())
    }
}
