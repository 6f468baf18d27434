//! The ERF-GS trainer on wgpu.

pub mod cameras;
pub mod checkpoint;
pub mod config;
pub mod density;
pub mod eds;
pub mod evaluate;
mod feed;
mod kernels;
pub mod losses;
pub mod metrics;
pub mod reference;
pub mod scene;
pub mod schedule;
pub mod start;
pub mod static_set;
pub mod trainer;
pub mod trial;
