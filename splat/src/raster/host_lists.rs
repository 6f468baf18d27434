//! The CPU shape between splats and image: tile lists made on the host, eight threads a tile.

use wgpu::Buffer;

use super::{
    Frame, RasterError,
    bins::{Bins, Splat, bin},
    frame::{Sizes, grow},
    kernels::stage,
    rasteriser::{Render, Sums},
};
use crate::gpu::{Commands, Gpu, Kernel, Shape};

/// Side of a tile, pixels.
pub(super) const TILE: u32 = 16;
const SHARED: &str = include_str!("shared/blend_cpu.wgsl");
const LANES_SUBGROUP: &str = include_str!("shared/lanes_subgroup.wgsl");
const LANES_BARRIER: &str = include_str!("shared/lanes_barrier.wgsl");

/// The kernels.
#[derive(Debug)]
pub(super) struct HostLists {
    blend: Kernel,
    blend_with_depth: Kernel,
    blend_backward: Kernel,
    no_depth: Buffer,
}

impl HostLists {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        let blend = |label, with_depth: bool| {
            let constants = format!("const WITH_DEPTH = {with_depth};");
            stage(gpu, label, &constants, &[SHARED, include_str!("blend_cpu.wgsl")])
        };
        let lanes = if gpu.subgroup >= 8 { LANES_SUBGROUP } else { LANES_BARRIER };
        let parts = [SHARED, lanes, include_str!("blend_backward_cpu.wgsl")];
        Ok(Self {
            blend: blend("blend", false),
            blend_with_depth: blend("blend with depth", true),
            blend_backward: stage(gpu, "blend backward", "", &parts),
            no_depth: gpu.storage("no depth", 16)?,
        })
    }

    /// Waits for the splats and makes the tile lists.
    pub(super) fn make(&self, gpu: &Gpu, render: &Render, frame: &mut Frame) -> Result<(), RasterError> {
        let count = render.gaussians() as usize;
        let grid = &render.grid;
        let needed = frame.region.as_ref().map(|region| region.tiles(grid.tiles));
        let bins: Bins =
            gpu.read::<Splat, _>(&[(&frame.splats, count)], |slices| bin(slices[0], grid, needed.as_deref()))?;
        let entries = bins.entries.len();
        let [bytes, _] = Sizes::entries(Shape::Cpu, entries as u32);
        grow(gpu, &mut frame.entries, "frame.entries", bytes)?;
        gpu.upload(&frame.entries, 0, &bins.entries);
        gpu.upload(&frame.lists, 0, &bins.lists);
        gpu.upload(&frame.ranges, 0, &bins.ranges);
        frame.room = entries as u32;
        frame.range_count = bins.ranges.len() as u32;
        Ok(())
    }

    pub(super) fn blend(&self, commands: &mut Commands<'_>, render: &Render, frame: &Frame) {
        let (kernel, depth) = match &frame.depth {
            Some(depth) => (&self.blend_with_depth, depth),
            None => (&self.blend, &self.no_depth),
        };
        commands.dispatch(
            kernel,
            &[&render.uniform, &frame.splats, &frame.entries, &frame.lists, &frame.image, depth, &frame.stops],
            render.grid.count(),
        );
    }

    pub(super) fn blend_backward(
        &self,
        commands: &mut Commands<'_>,
        render: &Render,
        frame: &Frame,
        d_image: &Buffer,
        sums: &Sums,
    ) {
        commands.dispatch(
            &self.blend_backward,
            &[
                &render.uniform,
                &frame.splats,
                &frame.entries,
                &frame.lists,
                &frame.image,
                &frame.stops,
                d_image,
                &sums.sums,
            ],
            render.grid.count(),
        );
    }
}
