//! What a render leaves behind for its user and for the backward pass.

use wgpu::Buffer;

use super::RasterError;
use crate::gpu::{Gpu, GpuError};

/// A rendered image and what the backward pass needs. Grows as needed; reusable; several can be alive at once.
#[derive(Debug)]
pub struct Frame {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// vec4f a pixel, row-major: r, g, b over the background; the final transmittance. It may be longer than the image.
    pub image: Buffer,
    /// f32 a pixel: depth weighted by alpha and transmittance, not normalised (0 where nothing is). Present where the
    /// last render asked for it.
    pub depth: Option<Buffer>,
    /// Twelve floats a Gaussian, as the last render saw it: mean x, y (pixels) | conic a, b, c | opacity | half width
    /// and height (pixels; 0 where it is not visible) | r, g, b | depth (metres).
    pub splats: Buffer,
    pub(super) entries: Buffer,
    pub(super) lists: Buffer,
    pub(super) ranges: Buffer,
    pub(super) stops: Buffer,
    /// Intersections of the last render where the host counted them.
    pub(super) intersections: u32,
}

impl Frame {
    /// An empty frame.
    ///
    /// # Errors
    /// [`RasterError::Gpu`].
    pub fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        Ok(Self {
            width: 0,
            height: 0,
            image: gpu.storage("frame.image", 16)?,
            depth: None,
            splats: gpu.storage("frame.splats", 16)?,
            entries: gpu.storage("frame.entries", 16)?,
            lists: gpu.storage("frame.lists", 16)?,
            ranges: gpu.storage("frame.ranges", 16)?,
            stops: gpu.storage("frame.stops", 16)?,
            intersections: 0,
        })
    }

    /// Waits for the last render and says whether it is complete. Where it had more tile intersections than the frame
    /// had room for (only possible on the GPU shape, which does not wait), the frame grows and an error is returned:
    /// render again.
    ///
    /// # Errors
    /// [`RasterError::Overflow`], [`RasterError::Gpu`].
    pub fn check(&mut self, gpu: &Gpu) -> Result<(), RasterError> {
        Ok(gpu.wait("rendering")?)
    }
}

/// Replaces `buffer` by a larger one where it has less than `bytes` bytes.
pub(super) fn grow(gpu: &Gpu, buffer: &mut Buffer, label: &str, bytes: u64) -> Result<(), GpuError> {
    if buffer.size() < bytes {
        let limit = gpu.limits.max_storage_buffer_binding_size.min(gpu.limits.max_buffer_size);
        *buffer = gpu.storage(label, (bytes + bytes / 4).min(limit).max(bytes))?;
    }
    Ok(())
}
