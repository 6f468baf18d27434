//! The forward and the backward pass.

use std::{
    sync::{Mutex, PoisonError},
    time::Instant,
};

use wgpu::Buffer;

use super::{
    Deltas, Frame, GaussianBuffers, Gradients, RasterError, RenderOptions, View,
    bins::{Bins, Grid, Splat, bin},
    frame::grow,
    kernels::{Kernels, THREADS, TILES_TOGETHER},
    uniform::ViewUniform,
};
use crate::gpu::{Commands, Gpu};

/// The compiled kernels of the rasteriser and the buffers that its passes share.
#[derive(Debug)]
pub struct Rasteriser {
    kernels: Kernels,
    // Bound where a kernel has a binding that a render does not need. They differ, because a kernel may write two.
    unused: [Buffer; 3],
    scratch: Mutex<Scratch>,
}

/// Buffers that live no longer than one pass.
#[derive(Debug)]
struct Scratch {
    moments: Buffer,
    moments_colour: Buffer,
    d_blue: Buffer,
    d_splats: Buffer,
}

impl Scratch {
    fn make_room(&mut self, gpu: &Gpu, intersections: u32, gaussians: u32) -> Result<(), RasterError> {
        let entries = u64::from(intersections);
        grow(gpu, &mut self.moments, "moments", 16 * entries)?;
        grow(gpu, &mut self.moments_colour, "moments colour", 16 * entries)?;
        grow(gpu, &mut self.d_blue, "d_blue", 4 * entries)?;
        grow(gpu, &mut self.d_splats, "d_splats", 48 * u64::from(gaussians.max(1)))?;
        Ok(())
    }
}

/// What all stages of one render need to know.
#[derive(Debug)]
pub(super) struct Render {
    uniform: Buffer,
    grid: Grid,
}

impl Render {
    pub(super) fn new(
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Self, RasterError> {
        let tile = Kernels::tile(gpu.shape);
        let values = ViewUniform::new(gaussians, deltas, view, options, tile)?;
        let grid = Grid {
            image: [view.width, view.height],
            tile,
            tiles: [values.size[2], values.size[3]],
            three_sigma: options.three_sigma,
        };
        Ok(Self { uniform: gpu.uniform("view", &values), grid })
    }
}

impl Rasteriser {
    /// Compiles the kernels for the shape of `gpu`.
    ///
    /// # Errors
    /// [`RasterError::Gpu`].
    pub fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        let kernels = Kernels::new(gpu);
        gpu.wait("compiling the rasteriser")?;
        let small = |label| gpu.storage(label, 16);
        Ok(Self {
            kernels,
            unused: [small("unused 0")?, small("unused 1")?, small("unused 2")?],
            scratch: Mutex::new(Scratch {
                moments: small("moments")?,
                moments_colour: small("moments colour")?,
                d_blue: small("d_blue")?,
                d_splats: small("d_splats")?,
            }),
        })
    }

    /// Renders `gaussians` (with `deltas` added to the raw values of the first rows) as seen by `view` into `frame`.
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
        let render = Render::new(gpu, gaussians, deltas, view, options)?;
        self.prepare(gpu, gaussians, view, options, frame)?;
        self.project(gpu, gaussians, deltas, &render, frame);
        let bins = self.bin(gpu, gaussians, &render, frame)?;
        self.upload_bins(gpu, &bins, frame)?;
        self.blend(gpu, &render, frame);
        Ok(())
    }

    /// Splats of all Gaussians.
    pub(super) fn project(
        &self,
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        render: &Render,
        frame: &Frame,
    ) {
        let [delta_core, delta_sh] = self.delta_bindings(deltas);
        let mut commands = gpu.commands();
        commands.dispatch(
            &self.kernels.project,
            &[&render.uniform, &gaussians.core, &gaussians.sh, delta_core, delta_sh, &frame.splats],
            gaussians.count.div_ceil(THREADS),
        );
        commands.submit();
    }

    /// Tile lists, made on the host.
    pub(super) fn bin(
        &self,
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        render: &Render,
        frame: &Frame,
    ) -> Result<Bins, RasterError> {
        let count = gaussians.count as usize;
        Ok(gpu.read::<Splat, _>(&[(&frame.splats, count)], |slices| bin(slices[0], &render.grid))?)
    }

    pub(super) fn upload_bins(&self, gpu: &Gpu, bins: &Bins, frame: &mut Frame) -> Result<(), RasterError> {
        grow(gpu, &mut frame.entries, "frame.entries", 8 * bins.entries.len() as u64)?;
        gpu.upload(&frame.entries, 0, &bins.entries);
        gpu.upload(&frame.lists, 0, &bins.lists);
        gpu.upload(&frame.ranges, 0, &bins.ranges);
        frame.intersections = bins.entries.len() as u32;
        Ok(())
    }

    /// The image, from splats and lists.
    pub(super) fn blend(&self, gpu: &Gpu, render: &Render, frame: &Frame) {
        let (kernel, depth) = match &frame.depth {
            Some(depth) => (&self.kernels.blend_with_depth, depth),
            None => (&self.kernels.blend, &self.unused[0]),
        };
        let mut commands = gpu.commands();
        commands.dispatch(
            kernel,
            &[&render.uniform, &frame.splats, &frame.entries, &frame.lists, &frame.image, depth, &frame.stops],
            (render.grid.tiles[0] * render.grid.tiles[1]).div_ceil(TILES_TOGETHER),
        );
        commands.submit();
    }

    /// The gradients of a loss, given `d_image` (vec4f a pixel: dL/dr, dL/dg, dL/db, dL/d final transmittance), for the
    /// render that `frame` holds; the arguments must be those of the forward pass. Adds to `gradients`, overwrites
    /// `delta_gradients`, and updates `gradients.screen` where `statistics` is set.
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
        statistics: bool,
    ) -> Result<(), RasterError> {
        let mut values = ViewUniform::new(gaussians, deltas, view, options, Kernels::tile(gpu.shape))?;
        check_backward(&values, gaussians, view, frame, d_image, gradients, delta_gradients)?;
        values.switches[2] = u32::from(statistics);
        values.outputs[0] = u32::from(delta_gradients.is_some());
        values.outputs[1] = u32::from(delta_gradients.is_some_and(|d| d.sh.is_some()));
        let uniform = gpu.uniform("view", &values);
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        scratch.make_room(gpu, frame.intersections, gaussians.count)?;
        let mut commands = gpu.commands();
        let tiles = values.size[2] * values.size[3];
        self.blend_backward(&mut commands, &uniform, tiles, frame, d_image, &scratch);
        self.gather(&mut commands, &uniform, gaussians.count, frame, &scratch);
        self.project_backward(&mut commands, &uniform, gaussians, deltas, &scratch, gradients, delta_gradients);
        commands.submit();
        Ok(())
    }

    fn blend_backward(
        &self,
        commands: &mut Commands<'_>,
        uniform: &Buffer,
        tiles: u32,
        frame: &Frame,
        d_image: &Buffer,
        scratch: &Scratch,
    ) {
        commands.dispatch(
            &self.kernels.blend_backward,
            &[
                uniform,
                &frame.splats,
                &frame.entries,
                &frame.lists,
                &frame.image,
                &frame.stops,
                d_image,
                &scratch.moments,
                &scratch.moments_colour,
                &scratch.d_blue,
            ],
            tiles.div_ceil(TILES_TOGETHER),
        );
    }

    fn gather(&self, commands: &mut Commands<'_>, uniform: &Buffer, count: u32, frame: &Frame, scratch: &Scratch) {
        commands.dispatch(
            &self.kernels.gather,
            &[uniform, &frame.ranges, &scratch.moments, &scratch.moments_colour, &scratch.d_blue, &scratch.d_splats],
            count.div_ceil(THREADS),
        );
    }

    #[allow(clippy::too_many_arguments)]
    fn project_backward(
        &self,
        commands: &mut Commands<'_>,
        uniform: &Buffer,
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        scratch: &Scratch,
        gradients: &Gradients,
        delta_gradients: Option<&Deltas>,
    ) {
        let [delta_core, delta_sh] = self.delta_bindings(deltas);
        commands.dispatch(
            &self.kernels.project_backward,
            &[
                uniform,
                &gaussians.core,
                &gaussians.sh,
                delta_core,
                delta_sh,
                &scratch.d_splats,
                &gradients.core,
                &gradients.sh,
                delta_gradients.map_or(&self.unused[1], |d| &d.core),
                delta_gradients.and_then(|d| d.sh.as_ref()).unwrap_or(&self.unused[2]),
                &gradients.screen,
            ],
            gaussians.count.div_ceil(THREADS),
        );
    }

    /// Runs both passes with a wait after each stage, and appends the milliseconds that each took.
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
        timed: &mut Vec<(&'static str, f64)>,
    ) -> Result<(), RasterError> {
        let mut start = Instant::now();
        let mut lap = |name| -> Result<(), RasterError> {
            gpu.wait("timing a stage")?;
            timed.push((name, start.elapsed().as_secs_f64() * 1e3));
            start = Instant::now();
            Ok(())
        };
        let render = Render::new(gpu, gaussians, None, view, options)?;
        self.prepare(gpu, gaussians, view, options, frame)?;
        lap("prepare")?;
        self.project(gpu, gaussians, None, &render, frame);
        lap("project")?;
        let bins = self.bin(gpu, gaussians, &render, frame)?;
        lap("bin")?;
        self.upload_bins(gpu, &bins, frame)?;
        gpu.queue.submit([]);
        lap("upload bins")?;
        self.blend(gpu, &render, frame);
        lap("blend")?;
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        scratch.make_room(gpu, frame.intersections, gaussians.count)?;
        let tiles = render.grid.tiles[0] * render.grid.tiles[1];
        let mut commands = gpu.commands();
        self.blend_backward(&mut commands, &render.uniform, tiles, frame, d_image, &scratch);
        commands.submit();
        lap("blend backward")?;
        let mut commands = gpu.commands();
        self.gather(&mut commands, &render.uniform, gaussians.count, frame, &scratch);
        commands.submit();
        lap("gather")?;
        let mut commands = gpu.commands();
        self.project_backward(&mut commands, &render.uniform, gaussians, None, &scratch, gradients, None);
        commands.submit();
        lap("project backward")
    }

    fn delta_bindings<'a>(&'a self, deltas: Option<&'a Deltas>) -> [&'a Buffer; 2] {
        [
            deltas.map_or(&self.unused[0], |deltas| &deltas.core),
            deltas.and_then(|deltas| deltas.sh.as_ref()).unwrap_or(&self.unused[0]),
        ]
    }

    /// Makes room in `frame`.
    fn prepare(
        &self,
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        view: &View,
        options: &RenderOptions,
        frame: &mut Frame,
    ) -> Result<(), RasterError> {
        let pixels = u64::from(view.width) * u64::from(view.height);
        let tile = Kernels::tile(gpu.shape);
        let tiles = u64::from(view.width.div_ceil(tile)) * u64::from(view.height.div_ceil(tile));
        (frame.width, frame.height) = (view.width, view.height);
        grow(gpu, &mut frame.image, "frame.image", 16 * pixels)?;
        grow(gpu, &mut frame.stops, "frame.stops", 4 * pixels)?;
        grow(gpu, &mut frame.lists, "frame.lists", 16 * tiles)?;
        grow(gpu, &mut frame.splats, "frame.splats", 48 * u64::from(gaussians.count.max(1)))?;
        grow(gpu, &mut frame.ranges, "frame.ranges", 8 * u64::from(gaussians.count))?;
        if !options.depth {
            frame.depth = None;
        } else if frame.depth.as_ref().is_none_or(|depth| depth.size() < 4 * pixels) {
            frame.depth = Some(gpu.storage("frame.depth", 4 * pixels)?);
        }
        Ok(())
    }
}

fn check_backward(
    values: &ViewUniform,
    gaussians: &GaussianBuffers,
    view: &View,
    frame: &Frame,
    d_image: &Buffer,
    gradients: &Gradients,
    delta_gradients: Option<&Deltas>,
) -> Result<(), RasterError> {
    let rows = u64::from(gaussians.count);
    let stride = u64::from(values.counts[3]);
    let delta_rows = u64::from(values.counts[1]);
    let reason = if (frame.width, frame.height) != (view.width, view.height)
        || frame.ranges.size() < 8 * rows
        || d_image.size() < 16 * u64::from(view.width) * u64::from(view.height)
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
