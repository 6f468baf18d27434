//! What a render leaves behind for its user and for the backward pass.

use std::sync::Arc;

use wgpu::Buffer;

use super::{RasterError, Region};
use crate::{
    gpu::{Gpu, GpuError, Shape, Submission, stored},
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

/// Bytes of the buffers of a frame that shows so many pixels in so many tiles, and so many Gaussians.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    pub image: u64,
    pub stops: u64,
    pub lists: u64,
    pub splats: u64,
    pub ranges: u64,
}

impl Sizes {
    pub fn new(pixels: u64, tiles: u32, gaussians: u32) -> Self {
        let gaussians = u64::from(gaussians);
        Self {
            image: 16 * pixels,
            stops: 4 * pixels,
            lists: 16 * u64::from(tiles),
            splats: 64 * gaussians.max(1),
            ranges: 16 * gaussians,
        }
    }

    pub fn depth(pixels: u64) -> u64 {
        4 * pixels
    }

    /// Of the entries and of their owners where there is room for so many tile intersections.
    pub fn entries(shape: Shape, room: u32) -> [u64; 2] {
        let room = u64::from(room);
        match shape {
            Shape::Cpu => [8 * room, 0],
            Shape::Gpu => [4 * room; 2],
        }
    }

    /// All of them, each as large as [`grow`] makes it, and the depth.
    pub fn all(self, pixels: u64, entries: [u64; 2]) -> u64 {
        let [entries, owners] = entries;
        let growing = [self.image, self.stops, self.lists, self.splats, self.ranges, entries, owners];
        growing.into_iter().map(|bytes| stored(grown(bytes))).sum::<u64>() + stored(Self::depth(pixels))
    }
}

/// Bytes that a buffer gets which has less than it needs.
pub(super) fn grown(bytes: u64) -> u64 {
    bytes + bytes / 4
}

/// Replaces `buffer` by a larger one where it has less than `bytes` bytes.
pub(super) fn grow(gpu: &Gpu, buffer: &mut Buffer, label: &str, bytes: u64) -> Result<(), GpuError> {
    if buffer.size() < bytes {
        let limit = gpu.limits.max_storage_buffer_binding_size.min(gpu.limits.max_buffer_size);
        *buffer = gpu.storage(label, grown(bytes).min(limit).max(bytes))?;
    }
    Ok(())
}
