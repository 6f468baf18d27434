//! The GPU shape between splats and image: tile lists sorted on the device, a workgroup a tile, nothing read back.

use std::sync::{Mutex, PoisonError};

use wgpu::Buffer;

use super::{
    Frame, RasterError,
    frame::{Sizes, grow},
    kernels::{THREADS, stage},
    rasteriser::{Render, Sums},
};
use crate::{
    gpu::{Commands, Gpu, Kernel, Shape, stored},
    sort::{Plan, RadixSort, ScanBuffers, SortBuffers},
};

/// Side of a tile, pixels.
pub(super) const TILE: u32 = 16;
const TILES: &str = include_str!("shared/tiles.wgsl");
const BACKWARD: &str = include_str!("shared/backward_tiles.wgsl");

/// The kernels and what they share from render to render.
#[derive(Debug)]
pub(super) struct DeviceLists {
    intersect: Kernel,
    order: Kernel,
    emit: Kernel,
    plan_tiles: Kernel,
    tile_ranges: Kernel,
    blend: Kernel,
    blend_with_depth: Kernel,
    blend_backward: Kernel,
    sort: RadixSort,
    no_depth: Buffer,
    scratch: Mutex<Scratch>,
}

/// What no render needs after its forward pass.
#[derive(Debug)]
struct Scratch {
    /// Gaussians that the plans are for.
    planned: Option<u32>,
    /// Tiles that each Gaussian touches.
    counts: Buffer,
    /// First emission index of each Gaussian, in order of depth.
    offsets: Buffer,
    offset_plan: Buffer,
    by_depth: SortBuffers,
    by_tile: SortBuffers,
    offset_scan: ScanBuffers,
}

impl Scratch {
    fn new(gpu: &Gpu, sort: &RadixSort, gaussians: u32, intersections: u32) -> Result<Self, RasterError> {
        Ok(Self {
            planned: None,
            counts: gpu.storage("tile counts", Self::each(gaussians))?,
            offsets: gpu.storage("offsets", Self::each(gaussians))?,
            offset_plan: gpu.storage("plan of the offsets", size_of::<Plan>() as u64)?,
            by_depth: sort.buffers(gpu, "by depth", gaussians)?,
            by_tile: sort.buffers(gpu, "by tile", intersections)?,
            offset_scan: ScanBuffers::new(gpu, gaussians)?,
        })
    }

    /// Bytes of a number for each Gaussian.
    fn each(gaussians: u32) -> u64 {
        4 * u64::from(gaussians)
    }
}

/// Bytes of what renders share, with room for so many Gaussians and intersections.
pub(super) fn bytes(gaussians: u32, intersections: u32) -> u64 {
    2 * stored(Scratch::each(gaussians))
        + stored(size_of::<Plan>() as u64)
        + SortBuffers::bytes(gaussians)
        + SortBuffers::bytes(intersections)
        + ScanBuffers::bytes(gaussians)
}

/// The form that the device's subgroups allow.
fn blend_backward(gpu: &Gpu) -> Kernel {
    let label = "blend backward";
    match gpu.subgroup.min(32) {
        lanes if lanes >= 4 && lanes.is_power_of_two() => {
            let constants = format!("const LANES = {lanes}u;");
            stage(gpu, label, &constants, &[TILES, BACKWARD, include_str!("blend_backward_subgroups.wgsl")])
        }
        _ => stage(gpu, label, "", &[TILES, BACKWARD, include_str!("blend_backward_gpu.wgsl")]),
    }
}

impl DeviceLists {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        let threads = format!("const THREADS = {THREADS}u;");
        let per_gaussian = |label, text| stage(gpu, label, &threads, &[TILES, text]);
        let with_plan = |label, text| stage(gpu, label, crate::sort::SHARED, &[text]);
        let blend = |label, with_depth: bool| {
            let constants = format!("const WITH_DEPTH = {with_depth};");
            stage(gpu, label, &constants, &[TILES, include_str!("blend_gpu.wgsl")])
        };
        let sort = RadixSort::new(gpu);
        let scratch = Mutex::new(Scratch::new(gpu, &sort, 0, 0)?);
        Ok(Self {
            intersect: per_gaussian("intersect", include_str!("intersect.wgsl")),
            order: per_gaussian("order", include_str!("order.wgsl")),
            emit: per_gaussian("emit", include_str!("emit.wgsl")),
            plan_tiles: with_plan("plan tiles", include_str!("plan_tiles.wgsl")),
            tile_ranges: with_plan("tile ranges", include_str!("tile_ranges.wgsl")),
            blend: blend("blend", false),
            blend_with_depth: blend("blend with depth", true),
            blend_backward: blend_backward(gpu),
            sort,
            no_depth: gpu.storage("no depth", 16)?,
            scratch,
        })
    }

    /// Records the making of the tile lists.
    pub(super) fn make(&self, gpu: &Gpu, render: &Render, frame: &mut Frame) -> Result<(), RasterError> {
        let gaussians = render.gaussians();
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        if scratch.by_depth.capacity < gaussians || scratch.by_tile.capacity < frame.room {
            let [gaussians, room] =
                [gaussians.max(scratch.by_depth.capacity), frame.room.max(scratch.by_tile.capacity)];
            *scratch = Scratch::new(gpu, &self.sort, gaussians, room)?;
        }
        let [entries, owners] = Sizes::entries(Shape::Gpu, frame.room);
        grow(gpu, &mut frame.entries, "frame.entries", entries)?;
        grow(gpu, &mut frame.owners, "frame.owners", owners)?;
        // No kernel changes how many there are.
        if scratch.planned.replace(gaussians) != Some(gaussians) {
            gpu.upload(&scratch.by_depth.plan, 0, &[Plan::sort(gaussians)]);
            gpu.upload(&scratch.offset_plan, 0, &[Plan::scan(gaussians)]);
        }

        let mut commands = gpu.commands();
        let groups = gaussians.div_ceil(THREADS);
        let Scratch { counts, offsets, offset_plan, by_depth, by_tile, offset_scan, .. } = &*scratch;
        let (view, ranges) = (&render.uniform, &frame.ranges);
        commands.dispatch(&self.intersect, &[view, &frame.splats, counts, &by_depth.keys, &by_depth.values], groups);
        by_depth.sort(&mut commands, 32, Some(gaussians));
        commands.dispatch(&self.order, &[view, counts, &by_depth.values, offsets], groups);
        self.sort.prefix_sum.record(&mut commands, offset_plan, offsets, offset_scan);
        commands.dispatch(
            &self.emit,
            &[
                view,
                &frame.splats,
                counts,
                &by_depth.values,
                offsets,
                ranges,
                &by_tile.keys,
                &by_tile.values,
                &frame.owners,
            ],
            groups,
        );
        commands.dispatch(&self.plan_tiles, &[view, offset_plan, &by_tile.plan], 1);
        // One key more than there are tiles: see emit.wgsl.
        let bits = u32::BITS - render.grid.count().leading_zeros();
        by_tile.sort(&mut commands, bits, None);
        commands.copy(&by_tile.values, &frame.entries, 4 * u64::from(frame.room));
        commands.clear(&frame.lists);
        commands.dispatch_indirect(
            &self.tile_ranges,
            &[view, &by_tile.plan, &by_tile.keys, &frame.lists],
            &by_tile.plan,
            Plan::BLOCK_GROUPS,
        );
        commands.copy(offset_plan, &frame.counter, size_of::<Plan>() as u64);
        frame.pending = Some(commands.submit());
        frame.range_count = gaussians;
        Ok(())
    }

    pub(super) fn blend(&self, commands: &mut Commands<'_>, render: &Render, frame: &Frame) {
        let (kernel, depth) = match &frame.depth {
            Some(depth) => (&self.blend_with_depth, depth),
            None => (&self.blend, &self.no_depth),
        };
        commands.dispatch(
            kernel,
            &[
                &render.uniform,
                &frame.splats,
                &frame.entries,
                &frame.owners,
                &frame.lists,
                &frame.image,
                depth,
                &frame.stops,
            ],
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
                &frame.owners,
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
