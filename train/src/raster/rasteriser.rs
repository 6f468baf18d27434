//! The forward and the backward pass.

use wgpu::Buffer;

use super::{Deltas, Frame, GaussianBuffers, Gradients, RasterError, RenderOptions, View};
use crate::gpu::Gpu;

/// The compiled kernels of the rasteriser.
#[derive(Debug)]
pub struct Rasteriser {}

impl Rasteriser {
    /// Compiles the kernels for the shape of `gpu`.
    ///
    /// # Errors
    /// [`RasterError::Gpu`].
    pub fn new(_gpu: &Gpu) -> Result<Self, RasterError> {
        Ok(Self {})
    }

    /// Renders `gaussians` (with `deltas` added to the raw values of the first rows) as seen by `view` into `frame`.
    ///
    /// # Errors
    /// [`RasterError`].
    #[allow(clippy::too_many_arguments)]
    pub fn forward(
        &self,
        gpu: &Gpu,
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        view: &View,
        options: &RenderOptions,
        frame: &mut Frame,
    ) -> Result<(), RasterError> {
        let _ = (gpu, gaussians, deltas, view, options, frame);
        Ok(())
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
        let _ = (gpu, gaussians, deltas, view, options, frame, d_image, gradients, delta_gradients, statistics);
        Ok(())
    }
}
