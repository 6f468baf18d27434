//! Gaussians that move, and their differentiable renderer on wgpu.
//!
//! - [`trained`]: what a run has learned, drawn from its folder alone; [`container`]: its file.
//! - [`gpu`]: the device that every kernel runs on; [`sort`]: prefix sums and the radix sort.
//! - [`gaussians`]: their parameters in rows, on the host; [`ply`]: their point clouds.
//! - [`motion`]: how they move, with gradients; [`field`]: the deformation field of 4DGS.
//! - [`raster`]: the rasteriser and its gradients; [`model`]: Gaussians and their motion on the device, drawn by it.
//! - [`optimiser`]: Adam; [`matrix`]: products of matrices on the host.
//! - [`reference`](mod@reference): the definition of each kernel in double precision.
//! - [`shaders`]: the texts of the kernels that draw, for viewers with a device of their own.

pub mod container;
pub mod field;
pub mod gaussians;
pub mod gpu;
pub mod matrix;
pub mod model;
pub mod motion;
mod near;
pub mod optimiser;
pub mod ply;
pub mod raster;
pub mod reference;
pub mod shaders;
pub mod sort;
pub mod trained;

pub use near::{near_plane, near_plane_beside};

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
