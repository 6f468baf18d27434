//! The ERF-GS trainer on wgpu.

pub mod field;
pub mod gpu;
pub mod metrics;
pub mod optimiser;
pub mod raster;
pub mod reference;
pub mod run;
