//! What a render leaves behind for its user and for the backward pass.

use std::sync::Arc;

use wgpu::Buffer;

use super::{RasterError, Region};
use crate::{
    gpu::{Gpu, GpuError, Shape, Submission},
    sort::Plan,
};

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
    /// `Splat` of `shared/splat.wgsl`, sixteen floats a Gaussian, as the last render saw it.
    pub(super) splats: Buffer,
    /// The part of the image that is needed; everything where there is none. Set it before the forward pass.
    pub region: Option<Arc<Region>>,
    /// CPU shape: splat and emission index; GPU shape: emission index. Sorted by tile, then depth.
    pub(super) entries: Buffer,
    /// GPU shape: splat of each emission index.
    pub(super) owners: Buffer,
    /// vec4u: tile, first entry, end of entries.
    pub(super) lists: Buffer,
    /// vec4u: Gaussian, first emission index, number of entries.
    pub(super) ranges: Buffer,
    /// Rows of `ranges`.
    pub(super) range_count: u32,
    /// Entry at which each pixel had become opaque.
    pub(super) stops: Buffer,
    /// Entries that there is room for; on the CPU shape, that there are.
    pub(super) room: u32,
    /// GPU shape: the plan with the number of entries, for the host.
    pub(super) counter: Buffer,
    /// GPU shape: the submission that fills `counter`.
    pub(super) pending: Option<Submission>,
}

impl Frame {
    /// An empty frame.
    ///
    /// # Errors
    /// [`RasterError::Gpu`].
    pub fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        let small = |label| gpu.storage(label, 16);
        Ok(Self {
            width: 0,
            height: 0,
            image: small("frame.image")?,
            depth: None,
            splats: small("frame.splats")?,
            region: None,
            entries: small("frame.entries")?,
            owners: small("frame.owners")?,
            lists: small("frame.lists")?,
            ranges: small("frame.ranges")?,
            range_count: 0,
            stops: small("frame.stops")?,
            room: 0,
            counter: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("frame.counter"),
                size: size_of::<Plan>() as u64,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            pending: None,
        })
    }

    /// Waits for the last render and says whether it is complete. Where it had more tile intersections than the frame
    /// had room for (only possible on the GPU shape, which does not wait), the frame grows and an error is returned:
    /// render again. Until then the farthest Gaussians are missing.
    ///
    /// # Errors
    /// [`RasterError::Overflow`], [`RasterError::Gpu`].
    pub fn check(&mut self, gpu: &Gpu) -> Result<(), RasterError> {
        let (room, needed) = (self.room, self.settle(gpu)?);
        gpu.wait("rendering")?;
        if gpu.shape == Shape::Gpu && needed.is_some_and(|needed| needed > room) {
            return Err(RasterError::Overflow { needed: u64::from(needed.unwrap_or(room)), capacity: u64::from(room) });
        }
        Ok(())
    }

    /// Tile intersections of the last render, where it has not been asked before. Makes room for them.
    pub(super) fn settle(&mut self, gpu: &Gpu) -> Result<Option<u32>, RasterError> {
        let Some(submission) = self.pending.take() else { return Ok(None) };
        // Only what was submitted up to that render is waited for, which by the next render has usually been done.
        let total = |bytes: &[u8]| bytemuck::from_bytes::<Plan>(bytes).total[0];
        let needed = gpu.read_mapped(&self.counter, &submission, "counting tile intersections", total)?;
        if needed > self.room {
            self.room = needed.saturating_add(needed / 4);
        }
        Ok(Some(needed))
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
