//! The forward and the backward pass.

use std::{
    sync::{Mutex, PoisonError},
    time::Instant,
};

use wgpu::Buffer;

use super::{
    Deltas, Frame, GaussianBuffers, Gradients, PoseRow, RasterError, RenderOptions, Thresholds, View, Wanted,
    bins::Grid,
    device_lists::{self, DeviceLists},
    frame::{Sizes, grow, grown},
    host_lists::{self, HostLists},
    kernels::{GaussianStages, THREADS},
    uniform::ViewUniform,
};
use crate::gpu::{Commands, Gpu, Shape, stored};

/// The compiled kernels of the rasteriser and the buffers that its passes share.
#[derive(Debug)]
pub struct Rasteriser {
    stages: GaussianStages,
    lists: Lists,
    thresholds: Thresholds,
    // Bound where a kernel has a binding that a render does not need. They differ, because a kernel may write two.
    unused: [Buffer; 3],
    sums: Mutex<Sums>,
}

/// From splats to the image, by shape.
#[derive(Debug)]
enum Lists {
    Host(HostLists),
    Device(Box<DeviceLists>),
}

/// What a backward pass keeps between its stages.
#[derive(Debug)]
pub(super) struct Sums {
    pub(super) sums: Buffer,
    d_splats: Buffer,
    /// Of [`POSE_THREADS`] threads.
    pose: Buffer,
}

/// Threads that sum what Gaussians say of a pose.
const POSE_THREADS: u32 = 16 * THREADS;
const POSE_BYTES: u64 = POSE_THREADS as u64 * 32;

impl Sums {
    fn make_room(&mut self, gpu: &Gpu, entries: u32, gaussians: u32) -> Result<(), RasterError> {
        let [sums, d_splats] = Self::sizes(entries, gaussians);
        grow(gpu, &mut self.sums, "sums", sums)?;
        grow(gpu, &mut self.d_splats, "d_splats", d_splats)?;
        Ok(())
    }

    fn sizes(entries: u32, gaussians: u32) -> [u64; 2] {
        [36 * u64::from(entries), 40 * u64::from(gaussians.max(1))]
    }

    /// Bytes of them all where there is room for so many entries and Gaussians.
    pub(super) fn bytes(entries: u32, gaussians: u32) -> u64 {
        Self::sizes(entries, gaussians).into_iter().map(|bytes| stored(grown(bytes))).sum::<u64>() + POSE_BYTES
    }
}

/// What all stages of one render need to know.
#[derive(Debug)]
pub(super) struct Render {
    values: ViewUniform,
    pub(super) uniform: Buffer,
    pub(super) grid: Grid,
}

impl Render {
    fn new(gpu: &Gpu, values: ViewUniform, options: &RenderOptions, thresholds: &Thresholds) -> Self {
        let [width, height, columns, rows] = values.size;
        let grid = Grid {
            image: [width, height],
            tile: tile_side(gpu.shape),
            tiles: [columns, rows],
            three_sigma: options.three_sigma,
            negligible_alpha: thresholds.negligible_alpha,
        };
        Self { values, uniform: gpu.uniform("view", &values), grid }
    }

    pub(super) fn gaussians(&self) -> u32 {
        self.values.counts[0]
    }
}

/// Tile intersections that a frame on the GPU shape has room for at first, until a rendering needed more.
pub(super) fn first_room(gpu: &Gpu, gaussians: u32, tiles: u32) -> u32 {
    let most = (gpu.limits.max_storage_buffer_binding_size / 36).min(u64::from(u32::MAX)) as u32;
    gaussians.saturating_mul(4).saturating_add(tiles.saturating_mul(64)).min(most)
}

/// Side of a tile, pixels.
pub(super) fn tile_side(shape: Shape) -> u32 {
    match shape {
        Shape::Cpu => host_lists::TILE,
        Shape::Gpu => device_lists::TILE,
    }
}

impl Rasteriser {
    /// Compiles the kernels for the shape of `gpu`.
    ///
    /// # Errors
    /// [`RasterError::Gpu`].
    pub fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        Self::with_thresholds(gpu, Thresholds::default())
    }

    /// With other thresholds than those of the 3DGS code.
    ///
    /// # Errors
    /// [`RasterError::Arguments`] where one is not within 0 to 1, 0 excluded; [`RasterError::Gpu`].
    pub fn with_thresholds(gpu: &Gpu, thresholds: Thresholds) -> Result<Self, RasterError> {
        let Thresholds { negligible_alpha, least_transmittance } = thresholds;
        let normal = |value: f32| value.is_normal() && (0.0..=1.0).contains(&value);
        if !normal(negligible_alpha) || !normal(least_transmittance) {
            let reason =
                format!("alpha {negligible_alpha} and transmittance {least_transmittance} are not within 0 to 1");
            return Err(RasterError::Arguments { doing: "blend with these thresholds", reason });
        }
        let stages = GaussianStages::new(gpu);
        let lists = match gpu.shape {
            Shape::Cpu => Lists::Host(HostLists::new(gpu)?),
            Shape::Gpu => Lists::Device(Box::new(DeviceLists::new(gpu)?)),
        };
        gpu.wait("compiling the rasteriser")?;
        let small = |label| gpu.storage(label, 16);
        Ok(Self {
            stages,
            lists,
            thresholds,
            unused: [small("unused 0")?, small("unused 1")?, small("unused 2")?],
            sums: Mutex::new(Sums {
                sums: small("sums")?,
                d_splats: small("d_splats")?,
                pose: gpu.storage("pose", POSE_BYTES)?,
            }),
        })
    }

    /// Renders `gaussians` (with `deltas` added to the raw values of the first rows) as seen by `view` into `frame`.
    ///
    /// On the GPU shape nothing is waited for, so that a render that needs more room than `frame` has is found later:
    /// by [`Frame::check`], or else by the next render into the same frame, which makes room.
    ///
    /// # Errors
    /// [`RasterError`].
    pub fn forward(
        &self,
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        view: &View,
        options: &RenderOptions,
        frame: &mut Frame,
    ) -> Result<(), RasterError> {
        let render = self.prepare(gpu, gaussians, deltas, view, options, frame)?;
        self.project(gpu, gaussians, deltas, &render, frame);
        self.make_lists(gpu, &render, frame)?;
        self.blend(gpu, &render, frame);
        Ok(())
    }

    /// The gradients of a loss, given `d_image` (vec4f a pixel: dL/dr, dL/dg, dL/db, dL/d final transmittance), for the
    /// render that `frame` holds; the arguments must be those of the forward pass. Adds to `gradients`, overwrites
    /// `delta_gradients`, and keeps what else is `wanted`.
    ///
    /// # Errors
    /// [`RasterError`].
    #[allow(clippy::too_many_arguments)]
    pub fn backward(
        &self,
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        view: &View,
        options: &RenderOptions,
        frame: &Frame,
        d_image: &Buffer,
        gradients: &Gradients,
        delta_gradients: Option<&Deltas>,
        wanted: Wanted<'_>,
    ) -> Result<(), RasterError> {
        let mut values = ViewUniform::new(gaussians, deltas, view, options, &self.thresholds, tile_side(gpu.shape))?;
        check_backward(&values, frame, d_image, gradients, delta_gradients)?;
        // The lists of the CPU shape leave out what is outside of a region, those of the GPU shape do not.
        let in_part = gpu.shape == Shape::Gpu && frame.region.is_some();
        values.switches[2] = u32::from(wanted.statistics)
            | u32::from(options.still_learn) << 1
            | u32::from(in_part) << 2
            | u32::from(wanted.pose.is_some()) << 3;
        values.outputs[0] = u32::from(delta_gradients.is_some());
        values.outputs[1] = u32::from(delta_gradients.is_some_and(|d| d.sh.is_some()));
        values.outputs[2] = frame.range_count;
        let render = Render::new(gpu, values, options, &self.thresholds);
        let mut sums = self.sums.lock().unwrap_or_else(PoisonError::into_inner);
        sums.make_room(gpu, frame.room, gaussians.count)?;
        let mut commands = gpu.commands();
        self.blend_backward(&mut commands, &render, frame, d_image, &sums);
        self.gather(&mut commands, &render, frame, &sums);
        for buffer in delta_gradients.iter().flat_map(|d| std::iter::once(&d.core).chain(&d.sh)) {
            commands.clear(buffer);
        }
        self.project_backward(&mut commands, &render, gaussians, deltas, &sums, gradients, delta_gradients);
        if let Some(pose) = wanted.pose {
            self.sum_pose(gpu, &mut commands, &render, &sums, pose);
        }
        commands.submit();
        Ok(())
    }

    /// Checks the arguments and makes room in `frame`.
    fn prepare(
        &self,
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        view: &View,
        options: &RenderOptions,
        frame: &mut Frame,
    ) -> Result<Render, RasterError> {
        let mut values = ViewUniform::new(gaussians, deltas, view, options, &self.thresholds, tile_side(gpu.shape))?;
        let pixels = u64::from(view.width) * u64::from(view.height);
        let tiles = values.size[2] * values.size[3];
        frame.settle(gpu)?;
        (frame.width, frame.height) = (view.width, view.height);
        let sizes = Sizes::new(pixels, tiles, gaussians.count);
        grow(gpu, &mut frame.image, "frame.image", sizes.image)?;
        grow(gpu, &mut frame.stops, "frame.stops", sizes.stops)?;
        grow(gpu, &mut frame.lists, "frame.lists", sizes.lists)?;
        grow(gpu, &mut frame.splats, "frame.splats", sizes.splats)?;
        grow(gpu, &mut frame.ranges, "frame.ranges", sizes.ranges)?;
        if gpu.shape == Shape::Gpu {
            frame.room = frame.room.max(options.first_room.unwrap_or(first_room(gpu, gaussians.count, tiles)));
            values.switches[3] = frame.room;
        }
        if !options.depth {
            frame.depth = None;
        } else if frame.depth.as_ref().is_none_or(|depth| depth.size() < Sizes::depth(pixels)) {
            frame.depth = Some(gpu.storage("frame.depth", Sizes::depth(pixels))?);
        }
        Ok(Render::new(gpu, values, options, &self.thresholds))
    }

    fn project(&self, gpu: &Gpu, gaussians: &GaussianBuffers, deltas: Option<&Deltas>, render: &Render, frame: &Frame) {
        let [delta_core, delta_sh] = self.delta_bindings(deltas);
        let mut commands = gpu.commands();
        commands.dispatch(
            &self.stages.project,
            &[&render.uniform, &gaussians.core, &gaussians.sh, delta_core, delta_sh, &frame.splats],
            gaussians.count.div_ceil(THREADS),
        );
        commands.submit();
    }

    fn make_lists(&self, gpu: &Gpu, render: &Render, frame: &mut Frame) -> Result<(), RasterError> {
        match &self.lists {
            Lists::Host(lists) => lists.make(gpu, render, frame),
            Lists::Device(lists) => lists.make(gpu, render, frame),
        }
    }

    fn blend(&self, gpu: &Gpu, render: &Render, frame: &Frame) {
        let mut commands = gpu.commands();
        match &self.lists {
            Lists::Host(lists) => lists.blend(&mut commands, render, frame),
            Lists::Device(lists) => lists.blend(&mut commands, render, frame),
        }
        commands.submit();
    }

    fn blend_backward(
        &self,
        commands: &mut Commands<'_>,
        render: &Render,
        frame: &Frame,
        d_image: &Buffer,
        sums: &Sums,
    ) {
        match &self.lists {
            Lists::Host(lists) => lists.blend_backward(commands, render, frame, d_image, sums),
            Lists::Device(lists) => lists.blend_backward(commands, render, frame, d_image, sums),
        }
    }

    fn gather(&self, commands: &mut Commands<'_>, render: &Render, frame: &Frame, sums: &Sums) {
        commands.dispatch(
            &self.stages.gather,
            &[&render.uniform, &frame.splats, &frame.ranges, &sums.sums, &sums.d_splats],
            frame.range_count.div_ceil(THREADS),
        );
    }

    #[allow(clippy::too_many_arguments)]
    fn project_backward(
        &self,
        commands: &mut Commands<'_>,
        render: &Render,
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        sums: &Sums,
        gradients: &Gradients,
        delta_gradients: Option<&Deltas>,
    ) {
        let [delta_core, delta_sh] = self.delta_bindings(deltas);
        commands.dispatch(
            &self.stages.project_backward,
            &[
                &render.uniform,
                &gaussians.core,
                &gaussians.sh,
                delta_core,
                delta_sh,
                &sums.d_splats,
                &gradients.core,
                &gradients.sh,
                delta_gradients.map_or(&self.unused[1], |d| &d.core),
                delta_gradients.and_then(|d| d.sh.as_ref()).unwrap_or(&self.unused[2]),
                &gradients.screen,
            ],
            render.values.outputs[2].div_ceil(THREADS),
        );
    }

    fn sum_pose(&self, gpu: &Gpu, commands: &mut Commands<'_>, render: &Render, sums: &Sums, to: PoseRow<'_>) {
        let partial = [&render.uniform, &sums.d_splats, &sums.pose];
        commands.dispatch(&self.stages.pose_partial, &partial, POSE_THREADS / THREADS);
        let row = gpu.uniform("row of a camera", &[to.row, POSE_THREADS, 0, 0]);
        commands.dispatch(&self.stages.pose_sum, &[&row, &sums.pose, to.sums], 1);
    }

    fn delta_bindings<'a>(&'a self, deltas: Option<&'a Deltas>) -> [&'a Buffer; 2] {
        [
            deltas.map_or(&self.unused[0], |deltas| &deltas.core),
            deltas.and_then(|deltas| deltas.sh.as_ref()).unwrap_or(&self.unused[0]),
        ]
    }

    /// Runs both passes with a wait after each stage; the milliseconds that each took.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn by_stage(
        &self,
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        view: &View,
        options: &RenderOptions,
        frame: &mut Frame,
        d_image: &Buffer,
        gradients: &Gradients,
    ) -> Result<Vec<(&'static str, f64)>, RasterError> {
        let mut timed = Vec::new();
        let mut start = Instant::now();
        let mut lap = |name| -> Result<(), RasterError> {
            gpu.wait("timing a stage")?;
            timed.push((name, start.elapsed().as_secs_f64() * 1e3));
            start = Instant::now();
            Ok(())
        };
        let render = self.prepare(gpu, gaussians, None, view, options, frame)?;
        lap("prepare")?;
        self.project(gpu, gaussians, None, &render, frame);
        lap("project")?;
        self.make_lists(gpu, &render, frame)?;
        gpu.queue.submit([]);
        lap("lists")?;
        self.blend(gpu, &render, frame);
        lap("blend")?;
        let mut values = render.values;
        values.outputs[2] = frame.range_count;
        let render = Render::new(gpu, values, options, &self.thresholds);
        let mut sums = self.sums.lock().unwrap_or_else(PoisonError::into_inner);
        sums.make_room(gpu, frame.room, gaussians.count)?;
        let mut commands = gpu.commands();
        self.blend_backward(&mut commands, &render, frame, d_image, &sums);
        commands.submit();
        lap("blend backward")?;
        let mut commands = gpu.commands();
        self.gather(&mut commands, &render, frame, &sums);
        commands.submit();
        lap("gather")?;
        let mut commands = gpu.commands();
        self.project_backward(&mut commands, &render, gaussians, None, &sums, gradients, None);
        commands.submit();
        lap("project backward")?;
        Ok(timed)
    }
}

fn check_backward(
    values: &ViewUniform,
    frame: &Frame,
    d_image: &Buffer,
    gradients: &Gradients,
    delta_gradients: Option<&Deltas>,
) -> Result<(), RasterError> {
    let [rows, delta_rows, _, stride] = values.counts.map(u64::from);
    let [width, height, ..] = values.size;
    let reason = if (frame.width, frame.height) != (width, height)
        || u64::from(frame.range_count) > rows
        || d_image.size() < 16 * u64::from(width) * u64::from(height)
    {
        "the frame or the gradient of the image is not of this view"
    } else if gradients.core.size() < 48 * rows
        || gradients.sh.size() < 4 * rows * stride
        || gradients.screen.size() < 16 * rows
    {
        "the gradient buffers are smaller than the Gaussians'"
    } else if delta_gradients.is_some_and(|d| {
        u64::from(d.rows) < delta_rows
            || delta_rows == 0
            || d.core.size() < 48 * delta_rows
            || d.sh.as_ref().is_some_and(|sh| sh.size() < 4 * delta_rows * stride)
    }) {
        "the buffers for the gradients of the deltas are smaller than the deltas"
    } else {
        return Ok(());
    };
    Err(RasterError::Arguments { doing: "differentiate a render", reason: reason.into() })
}
