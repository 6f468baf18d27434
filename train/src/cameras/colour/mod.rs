//! The colour response of each camera: a gain and an offset a channel, learned beside the scene.
//!
//! Cameras of one rig never agree on a colour. What disagrees would otherwise be explained by Gaussians before the lens of
//! the camera in question, which other views then see. A frame is compared with `gain * rendered + offset`, in display
//! values; a rendering for any other purpose is of the scene itself, as a camera of gain 1 and offset 0 sees it. That is the
//! mean of the training cameras: nothing else tells a brighter scene from more sensitive cameras.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use wgpu::Buffer;

use super::{CameraState, Quantity};
use crate::kernels::{kernel, threads_for};
use erfgs_splat::{
    gpu::{Commands, Gpu, GpuError, Kernel, stored},
    optimiser::{AdamConfig, decayed},
};

const STEP: &str = include_str!("step.wgsl");
/// A camera takes some hundred steps, so that the second moment forgets sooner than that of the scene.
const ADAM: AdamConfig = AdamConfig { beta1: 0.9, beta2: 0.99, epsilon: 1e-15 };

/// How the colour responses of the cameras are learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraColourOptions {
    /// Whether they are learned. Where not, all cameras are taken to agree.
    pub enabled: bool,
    /// From when on, as a share of the whole run: the scene comes first.
    pub from: f32,
    /// Learning rate of gains and offsets: first, last.
    pub rate: [f32; 2],
    /// Weight of `|gain - 1|^2 + |offset|^2`, which keeps the cameras together where the frames do not say.
    pub prior: f32,
}

impl Default for CameraColourOptions {
    fn default() -> Self {
        Self { enabled: false, from: 0.05, rate: [1e-2, 1e-3], prior: 0.01 }
    }
}

/// Eight numbers: gain and offset; red, green, blue and 1 where the camera takes part, else 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OfColour;

impl Quantity for OfColour {
    const NAME: &'static str = "camera-colours";
    const FLOATS: usize = 8;
    const SUMS: usize = 0;
}

/// Gains and offsets of all cameras, on the host.
pub type CameraColourState = CameraState<OfColour>;

impl CameraColourState {
    /// Of cameras that agree; those that take frames take part.
    #[must_use]
    pub fn neutral(takes_frames: &[bool]) -> Self {
        let row = |takes: &bool| {
            let takes = f32::from(u8::from(*takes));
            [1.0, 1.0, 1.0, takes, 0.0, 0.0, 0.0, takes]
        };
        Self::new(takes_frames.len(), takes_frames.iter().flat_map(row).collect())
    }

    /// Gain and offset of a camera, red, green, blue, as shares of full scale.
    #[must_use]
    pub fn of(&self, camera: usize) -> [[f32; 3]; 2] {
        let row = self.row(camera);
        [[row[0], row[1], row[2]], [row[4], row[5], row[6]]]
    }
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct StepUniform {
    view: u32,
    threads: u32,
    scale: f32,
    prior: f32,
    beta1: f32,
    beta2: f32,
    rate: f32,
    root_scale: f32,
    epsilon: f32,
    cameras: u32,
    unused: [u32; 2],
}

/// The colour responses on the device.
#[derive(Debug)]
pub struct CameraColours {
    pub(crate) values: Buffer,
    pub(crate) partial: Buffer,
    moments: [Buffer; 2],
    steps: Vec<u32>,
    kernel: Kernel,
}

fn size_of_partial(pixels: u32) -> u64 {
    u64::from(threads_for(pixels)) * 32
}

impl CameraColours {
    /// Puts `state` on the device, for images of up to `pixels` pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &Gpu, state: &CameraColourState, pixels: u32) -> Result<Self, GpuError> {
        Ok(Self {
            values: gpu.storage_from("colours of cameras", &state.values)?,
            partial: gpu.storage("gradient of a camera's colour", size_of_partial(pixels))?,
            moments: [
                gpu.storage_from("first moment of colours", &state.moments[0])?,
                gpu.storage_from("second moment of colours", &state.moments[1])?,
            ],
            steps: state.steps.clone(),
            kernel: kernel(gpu, "colour of a camera", &[STEP]),
        })
    }

    /// Bytes of the device's memory that they take.
    #[must_use]
    pub fn bytes(cameras: usize, pixels: u32) -> u64 {
        3 * stored((4 * OfColour::FLOATS * cameras) as u64) + stored(size_of_partial(pixels))
    }

    /// Takes up a state of as many cameras.
    pub(crate) fn restore(&mut self, gpu: &Gpu, state: &CameraColourState) {
        let [first, second] = &self.moments;
        for (buffer, values) in [(&self.values, &state.values), (first, &state.moments[0]), (second, &state.moments[1])]
        {
            gpu.upload(buffer, 0, values);
        }
        self.steps.clone_from(&state.steps);
    }

    /// How many floats `values` holds.
    pub(crate) fn floats(&self) -> u32 {
        (self.steps.len() * OfColour::FLOATS) as u32
    }

    /// Copies them to the host.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn state(&self, gpu: &Gpu) -> Result<CameraColourState, GpuError> {
        let read = |buffer: &Buffer| gpu.download(buffer, self.floats() as usize);
        let [first, second] = &self.moments;
        let mut state = CameraColourState::new(self.steps.len(), read(&self.values)?);
        (state.steps, state.moments) = (self.steps.clone(), [read(first)?, read(second)?]);
        Ok(state)
    }

    /// One step for the camera whose frame was just compared, `share` of the run being over. The comparison looked at
    /// `pixels` pixels.
    pub fn step(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands<'_>,
        view: usize,
        pixels: u32,
        options: &CameraColourOptions,
        share: f64,
    ) {
        self.steps[view] += 1;
        let (rate_scale, root_scale) = ADAM.bias_corrections(self.steps[view]);
        let uniform = StepUniform {
            view: view as u32,
            threads: threads_for(pixels),
            scale: 1.0 / (3.0 * pixels as f32),
            prior: options.prior,
            beta1: ADAM.beta1,
            beta2: ADAM.beta2,
            rate: rate_scale * decayed(options.rate, share),
            root_scale,
            epsilon: ADAM.epsilon,
            cameras: self.steps.len() as u32,
            unused: [0; 2],
        };
        let uniform = gpu.uniform("colour of a camera", &uniform);
        let [first, second] = &self.moments;
        commands.dispatch(&self.kernel, &[&uniform, &self.partial, &self.values, first, second], 1);
    }
}

#[cfg(test)]
mod tests;
