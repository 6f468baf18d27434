//! Device buffers that the rasteriser shares with its neighbours.

use crate::gpu::{Gpu, GpuError, stored};

/// What the deformation field adds to the raw parameters of the dynamic Gaussians, or the gradient of that.
#[derive(Clone, Debug)]
pub struct Deltas {
    /// The dynamic Gaussians: rows `0..rows` of the parameter buffers.
    pub rows: u32,
    /// `rows` x 12 f32 in the layout of the core parameters.
    pub core: wgpu::Buffer,
    /// `rows` x `sh_stride` f32 in the layout of the SH parameters; absent where the field leaves colour alone.
    pub sh: Option<wgpu::Buffer>,
}

impl Deltas {
    /// Zeroed deltas of `rows` rows, with `sh_stride` floats of SH a row if given.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &Gpu, label: &str, rows: u32, sh_stride: Option<u32>) -> Result<Self, GpuError> {
        let (core, sh) = Self::sizes(rows, sh_stride);
        let core = gpu.storage(&format!("{label} core"), core)?;
        let sh = sh.map(|bytes| gpu.storage(&format!("{label} sh"), bytes)).transpose()?;
        Ok(Self { rows, core, sh })
    }

    fn sizes(rows: u32, sh_stride: Option<u32>) -> (u64, Option<u64>) {
        let rows = u64::from(rows);
        (rows * 48, sh_stride.map(|stride| rows * u64::from(stride) * 4))
    }

    /// Bytes of the device's memory that so many rows take.
    #[must_use]
    pub fn bytes(rows: u32, sh_stride: Option<u32>) -> u64 {
        let (core, sh) = Self::sizes(rows, sh_stride);
        stored(core) + sh.map_or(0, stored)
    }
}
