//! The differentiable Gaussian rasteriser (Kerbl et al. 2023, with exact tile intersections).

mod bench;
mod bins;
mod buffers;
mod device_lists;
mod frame;
mod host_lists;
mod kernels;
mod load;
mod rasteriser;
mod region;
mod types;
mod uniform;

pub use bench::{BenchResult, BenchScene, bench};
pub use buffers::Deltas;
pub use frame::Frame;
pub use kernels::HARMONICS;
pub use load::Load;
pub use rasteriser::Rasteriser;
pub use region::Region;
pub use types::{
    CORE_STRIDE, GaussianBuffers, Gradients, LOW_PASS, PoseRow, RasterError, RenderOptions, Thresholds, View, Wanted,
    sh_stride,
};

#[cfg(test)]
mod tests;
