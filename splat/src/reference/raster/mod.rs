//! The rasteriser in plain `f64`: what its kernels are tested against. No tiles, no lists: every pixel looks at every
//! splat.

mod blend;
mod blend_backward;
mod project;

pub use blend::{Image, blend};
pub use blend_backward::{SplatGradient, blend_backward};
pub use project::{Splat, colour, pose, project, project_from};

use glam::{DMat3, DVec3};

use crate::raster::{CORE_STRIDE, RenderOptions, View, sh_stride};

/// The parameters of all Gaussians, in the layout of the device buffers; deltas already added.
#[derive(Clone, Debug)]
pub struct Gaussians {
    /// SH degree that `sh` has room for.
    pub sh_degree: u32,
    /// Rows of [`CORE_STRIDE`] numbers.
    pub core: Vec<f64>,
    /// Rows of `sh_stride(sh_degree)` numbers.
    pub sh: Vec<f64>,
}

impl Gaussians {
    /// Number of Gaussians.
    #[must_use]
    pub fn count(&self) -> usize {
        self.core.len() / CORE_STRIDE as usize
    }

    /// The splats of all Gaussians; none where a Gaussian is culled.
    #[must_use]
    pub fn splats(&self, view: &View, options: &RenderOptions) -> Vec<Option<Splat>> {
        self.splats_from(view, &pose(view), options)
    }

    /// The same from a pose of its own.
    #[must_use]
    pub fn splats_from(&self, view: &View, pose: &(DMat3, DVec3), options: &RenderOptions) -> Vec<Option<Splat>> {
        let stride = sh_stride(self.sh_degree) as usize;
        self.core
            .chunks_exact(CORE_STRIDE as usize)
            .zip(self.sh.chunks_exact(stride))
            .map(|(core, sh)| project_from(core, sh, view, pose, options))
            .collect()
    }

    /// The image.
    #[must_use]
    pub fn render(&self, view: &View, options: &RenderOptions) -> Image {
        blend(&self.splats(view, options), view, options)
    }
}
