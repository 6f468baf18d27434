//! The ERF-GS trainer on wgpu.

pub mod config;
pub mod export;
pub mod field;
pub mod gaussians;
pub mod gpu;
pub mod losses;
pub mod metrics;
pub mod optimiser;
pub mod raster;
pub mod reference;
pub mod run;
pub mod scene;
