//! Adam on the device.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use wgpu::Buffer;

use crate::gpu::{Commands, Gpu, GpuError, Kernel, Shape};

/// Constants of Adam (Kingma and Ba 2015), in the form of PyTorch: bias-corrected moments, epsilon outside the root.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdamConfig {
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// Added to the root of the second moment: 1e-15 in 4DGS, 1e-8 in ERF-GS.
    pub epsilon: f32,
}

impl Default for AdamConfig {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-15 }
    }
}

impl AdamConfig {
    /// 1 / (1 - beta1^step) and 1 / sqrt(1 - beta2^step), for a step that counts from 1.
    #[must_use]
    pub fn bias_corrections(&self, step: u32) -> (f32, f32) {
        let left = |beta: f32| 1.0 - f64::from(beta).powf(f64::from(step.max(1)));
        ((1.0 / left(self.beta1)) as f32, (1.0 / left(self.beta2).sqrt()) as f32)
    }
}

/// The buffers of one Adam step: `rows` rows of `stride` floats each.
#[derive(Clone, Copy, Debug)]
pub struct AdamBuffers<'a> {
    /// What is optimised.
    pub parameters: &'a Buffer,
    /// Their gradients; left as they are.
    pub gradients: &'a Buffer,
    /// Running means of the gradients.
    pub first_moment: &'a Buffer,
    /// Running means of their squares.
    pub second_moment: &'a Buffer,
    /// Rows to update.
    pub rows: u32,
    /// Floats a row, a multiple of 4.
    pub stride: u32,
    /// One `u32` a row; rows with 0 are left alone, moments included.
    pub mask: Option<&'a Buffer>,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Uniform {
    vectors: u32,
    row_vectors: u32,
    beta1: f32,
    beta2: f32,
    epsilon: f32,
    rate_scale: f32,
    root_scale: f32,
    padding: u32,
}

/// The Adam kernel.
#[derive(Debug)]
pub struct Adam {
    dense: Kernel,
    masked: Kernel,
    per_thread: u32,
}

impl Adam {
    /// Compiles the kernel.
    #[must_use]
    pub fn new(gpu: &Gpu) -> Self {
        let per_thread = match gpu.shape {
            Shape::Gpu => 1,
            Shape::Cpu => 16,
        };
        let constants = format!("const PER_THREAD = {per_thread}u;");
        let source = include_str!("adam.wgsl");
        Self {
            dense: gpu.kernel("adam", &[&constants, source]),
            masked: gpu.kernel("adam of masked rows", &[&constants, &source.replace("// MASK ", "")]),
            per_thread,
        }
    }

    /// Records one step. `lr_per_lane` holds `stride` learning rates, one for each column; `step` counts from 1.
    ///
    /// # Errors
    /// [`GpuError::Failed`] where the learning rates are not one a column, or the rows not multiples of 4 floats.
    pub fn step(
        &self,
        commands: &mut Commands<'_>,
        buffers: &AdamBuffers<'_>,
        lr_per_lane: &[f32],
        config: &AdamConfig,
        step: u32,
    ) -> Result<(), GpuError> {
        if buffers.stride == 0 || !buffers.stride.is_multiple_of(4) || lr_per_lane.len() != buffers.stride as usize {
            return Err(GpuError::Failed {
                doing: "recording an Adam step".into(),
                message: format!("rows of {} floats with {} learning rates", buffers.stride, lr_per_lane.len()),
            });
        }
        let gpu = commands.gpu();
        let (rate_scale, root_scale) = config.bias_corrections(step);
        let row_vectors = buffers.stride / 4;
        let uniform = gpu.uniform(
            "adam step",
            &Uniform {
                vectors: buffers.rows * row_vectors,
                row_vectors,
                beta1: config.beta1,
                beta2: config.beta2,
                epsilon: config.epsilon,
                rate_scale,
                root_scale,
                padding: 0,
            },
        );
        let rates = gpu.storage_from("learning rates", lr_per_lane)?;
        let mut bindings =
            vec![&uniform, &rates, buffers.gradients, buffers.parameters, buffers.first_moment, buffers.second_moment];
        bindings.extend(buffers.mask);
        let kernel = if buffers.mask.is_some() { &self.masked } else { &self.dense };
        commands.dispatch(kernel, &bindings, (buffers.rows * row_vectors).div_ceil(256 * self.per_thread));
        Ok(())
    }
}
