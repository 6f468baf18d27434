//! Adam on the device, and the check that numbers are still numbers.

use serde::{Deserialize, Serialize};
use wgpu::Buffer;

use crate::gpu::{Commands, Gpu, GpuError};

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

/// The buffers of one Adam step: `rows` rows of `stride` floats each.
#[derive(Clone, Copy, Debug)]
pub struct AdamBuffers<'a> {
    /// Parameters.
    pub parameters: &'a Buffer,
    /// Their gradients; left as they are.
    pub gradients: &'a Buffer,
    /// First moments.
    pub first_moment: &'a Buffer,
    /// Second moments.
    pub second_moment: &'a Buffer,
    /// Rows to update.
    pub rows: u32,
    /// Floats a row, a multiple of 4.
    pub stride: u32,
    /// One `u32` a row; rows with 0 are left alone, moments included.
    pub mask: Option<&'a Buffer>,
}

/// The Adam kernel.
#[derive(Debug)]
pub struct Adam {}

impl Adam {
    /// Compiles the kernel.
    pub fn new(_gpu: &Gpu) -> Self {
        todo!()
    }

    /// Records one step. `lr_per_lane` holds `stride` learning rates, one for each column; `step` counts from 1.
    pub fn step(
        &self,
        _commands: &mut Commands<'_>,
        _buffers: &AdamBuffers<'_>,
        _lr_per_lane: &[f32],
        _config: &AdamConfig,
        _step: u32,
    ) {
        todo!()
    }
}

/// Counts NaN and infinities in buffers of f32.
#[derive(Debug)]
pub struct FiniteCheck {}

impl FiniteCheck {
    /// Compiles the kernel.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(_gpu: &Gpu) -> Result<Self, GpuError> {
        todo!()
    }

    /// Records a scan of the first `floats` values of `buffer`.
    pub fn scan(&self, _commands: &mut Commands<'_>, _buffer: &Buffer, _floats: u32) {
        todo!()
    }

    /// Waits, returns how many values of all scans since the last call were not finite, and starts again at 0.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn take(&self, _gpu: &Gpu) -> Result<u32, GpuError> {
        todo!()
    }
}
