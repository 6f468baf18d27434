//! The check that numbers are still numbers.

use wgpu::Buffer;

use crate::gpu::{Commands, Gpu, GpuError, Kernel};

/// Counts NaN and infinities in buffers of f32.
#[derive(Debug)]
pub struct FiniteCheck {
    kernel: Kernel,
    found: Buffer,
}

impl FiniteCheck {
    /// Compiles the kernel.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            kernel: gpu.kernel("finite check", &[include_str!("finite.wgsl")]),
            found: gpu.storage("values that are not finite", 4)?,
        })
    }

    /// Records a scan of the first `floats` values of `buffer`.
    pub fn scan(&self, commands: &mut Commands<'_>, buffer: &Buffer, floats: u32) {
        let count = commands.gpu().uniform("values to check", &[floats, 0, 0, 0]);
        commands.dispatch(&self.kernel, &[&count, buffer, &self.found], floats.div_ceil(256 * 16).min(1024));
    }

    /// The counter (one `u32`), for kernels that find bad values themselves.
    #[must_use]
    pub fn counter(&self) -> &Buffer {
        &self.found
    }

    /// Waits, returns how many values of all scans since the last call were not finite, and starts again at 0.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn take(&self, gpu: &Gpu) -> Result<u32, GpuError> {
        let found = gpu.read(&[(&self.found, 1)], |slices: &[&[u32]]| slices[0][0])?;
        gpu.upload(&self.found, 0, &[0_u32]);
        Ok(found)
    }
}
