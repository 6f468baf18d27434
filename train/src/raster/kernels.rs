//! The kernels of both shapes.

use crate::gpu::{Gpu, Kernel, Shape};

const VIEW: &str = include_str!("shared/view.wgsl");
const SPLAT: &str = include_str!("shared/splat.wgsl");
const GAUSSIAN: &str = include_str!("shared/gaussian.wgsl");
const HARMONICS: &str = include_str!("shared/harmonics.wgsl");
const SPLAT_GRADIENT: &str = include_str!("shared/splat_gradient.wgsl");
const BLEND_CPU: &str = include_str!("shared/blend_cpu.wgsl");

/// Compiled kernels; each stage is the WGSL file of the same name.
#[derive(Debug)]
pub(super) struct Kernels {
    pub(super) project: Kernel,
    pub(super) blend: Kernel,
    pub(super) blend_with_depth: Kernel,
    pub(super) blend_backward: Kernel,
    pub(super) gather: Kernel,
    pub(super) project_backward: Kernel,
}

/// Threads of a workgroup of the stages with one thread a Gaussian.
pub(super) const THREADS: u32 = 64;
/// Threads of a workgroup of the blending of the CPU shape: as many tiles walk together.
pub(super) const TILES_TOGETHER: u32 = 8;

impl Kernels {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let threads = format!("const THREADS = {THREADS}u;");
        let tiles = format!("const THREADS = {TILES_TOGETHER}u;");
        let blend = |label, with_depth| {
            let constants = format!("{tiles} const WITH_DEPTH = {with_depth};");
            gpu.kernel(label, &[&constants, VIEW, SPLAT, BLEND_CPU, include_str!("blend_cpu.wgsl")])
        };
        Self {
            project: gpu.kernel("project", &[&threads, VIEW, SPLAT, GAUSSIAN, HARMONICS, include_str!("project.wgsl")]),
            blend: blend("blend", false),
            blend_with_depth: blend("blend with depth", true),
            blend_backward: gpu
                .kernel("blend backward", &[&tiles, VIEW, SPLAT, BLEND_CPU, include_str!("blend_backward_cpu.wgsl")]),
            gather: gpu.kernel("gather", &[&threads, VIEW, SPLAT_GRADIENT, include_str!("gather.wgsl")]),
            project_backward: gpu.kernel(
                "project backward",
                &[&threads, VIEW, SPLAT, GAUSSIAN, HARMONICS, SPLAT_GRADIENT, include_str!("project_backward.wgsl")],
            ),
        }
    }

    /// Side of a tile, pixels.
    pub(super) fn tile(shape: Shape) -> u32 {
        match shape {
            Shape::Cpu => 4,
            Shape::Gpu => 16,
        }
    }
}
