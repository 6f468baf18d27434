//! The ERF-GS trainer on wgpu.

pub mod gpu;
pub mod metrics;
pub mod run;
