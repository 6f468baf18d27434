//! How long each stage takes.

use std::time::Instant;

use erfgs_session::random::{key, normal, uniform};

use super::{
    Deltas, Frame, GaussianBuffers, Gradients, RasterError, Rasteriser, RenderOptions, View, rasteriser::Render,
    sh_stride,
};
use crate::gpu::Gpu;

/// What to render.
#[derive(Clone, Copy, Debug)]
pub struct BenchScene {
    /// Number of Gaussians, all of them in view.
    pub gaussians: u32,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Median standard deviation of a splat, pixels.
    pub sigma_px: f32,
}

/// Milliseconds of wall time (the best of several runs), each with a wait for the device at its end.
#[derive(Clone, Debug)]
pub struct BenchResult {
    /// Milliseconds by stage, in the order in which they run.
    pub stages: Vec<(&'static str, f64)>,
    /// A whole forward pass.
    pub forward_ms: f64,
    /// A whole backward pass.
    pub backward_ms: f64,
    /// Tile intersections of the image.
    pub intersections: u32,
}
