//! What rendering takes of the device's memory, by the functions that its buffers are made by.

use super::{
    device_lists,
    frame::Sizes,
    rasteriser::{Sums, first_room, tile_side},
};
use crate::gpu::{Gpu, Shape};

/// So many Gaussians in an image of this size. Each is taken to lie in four tiles, and each tile to have 64 more besides: what a frame has
/// room for at first. Where a rendering needs more, it takes more.
#[derive(Clone, Copy, Debug)]
pub struct Load {
    shape: Shape,
    pixels: u64,
    tiles: u32,
    gaussians: u32,
    room: u32,
}

impl Load {
    /// The load of `gaussians` in an image of `width` x `height` pixels.
    #[must_use]
    pub fn new(gpu: &Gpu, gaussians: u32, [width, height]: [u32; 2]) -> Self {
        let [columns, rows] = [width, height].map(|side| side.div_ceil(tile_side(gpu.shape)));
        let tiles = columns.saturating_mul(rows);
        let pixels = u64::from(width) * u64::from(height);
        Self { shape: gpu.shape, pixels, tiles, gaussians, room: first_room(gpu, gaussians, tiles) }
    }

    /// Bytes of a [`Frame`](super::Frame), its depth included.
    #[must_use]
    pub fn frame(&self) -> u64 {
        Sizes::new(self.pixels, self.tiles, self.gaussians).all(self.pixels, Sizes::entries(self.shape, self.room))
    }

    /// Bytes of what a [`Rasteriser`](super::Rasteriser) keeps for all frames.
    #[must_use]
    pub fn shared(&self) -> u64 {
        let lists = match self.shape {
            Shape::Cpu => 0,
            Shape::Gpu => device_lists::bytes(self.gaussians, self.room),
        };
        Sums::bytes(self.room, self.gaussians) + lists
    }
}
