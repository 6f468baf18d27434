//! How the stages are put together from their WGSL files.

use crate::gpu::{Gpu, Kernel};

const VIEW: &str = include_str!("shared/view.wgsl");
const SPLAT: &str = include_str!("shared/splat.wgsl");
const GAUSSIAN: &str = include_str!("shared/gaussian.wgsl");
/// WGSL of the basis of spherical harmonics and of how much of it is in use.
pub const HARMONICS: &str = include_str!("shared/harmonics.wgsl");
const COLOUR: &str = include_str!("shared/colour.wgsl");

/// Threads of a workgroup of the stages with one thread a Gaussian.
pub(super) const THREADS: u32 = 64;

/// A stage that sees the view and the splats.
pub(super) fn stage(gpu: &Gpu, label: &str, constants: &str, parts: &[&str]) -> Kernel {
    gpu.kernel(label, &[&[constants, VIEW, SPLAT], parts].concat())
}

/// The stages with one thread a Gaussian, which both shapes share.
#[derive(Debug)]
pub(super) struct GaussianStages {
    pub(super) project: Kernel,
    pub(super) gather: Kernel,
    pub(super) project_backward: Kernel,
    pub(super) pose_partial: Kernel,
    pub(super) pose_sum: Kernel,
}

impl GaussianStages {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let threads = format!("const THREADS = {THREADS}u;");
        let stage = |label, parts: &[&str]| stage(gpu, label, &threads, parts);
        Self {
            project: stage("project", &[GAUSSIAN, HARMONICS, COLOUR, include_str!("project.wgsl")]),
            gather: stage("gather", &[include_str!("gather.wgsl")]),
            project_backward: stage(
                "project backward",
                &[GAUSSIAN, HARMONICS, COLOUR, include_str!("project_backward.wgsl")],
            ),
            pose_partial: stage("pose", &[include_str!("pose_partial.wgsl")]),
            pose_sum: gpu.kernel("pose of a camera", &[include_str!("pose_sum.wgsl")]),
        }
    }
}
