//! PLY files: coloured point clouds, and the Gaussians of 3D Gaussian Splatting.

mod gaussians;
mod header;
mod points;

pub use gaussians::{GaussianCloud, GaussianCloudError};
pub use points::{PlyError, PointCloud};
