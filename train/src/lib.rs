//! The ERF-GS trainer on wgpu.

pub mod gpu;
