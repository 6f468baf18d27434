//! The ERF-GS trainer on wgpu.

pub mod camera_colour;
pub mod camera_pose;
pub mod camera_time;
pub mod checkpoint;
pub mod config;
pub mod density;
pub mod eds;
pub mod evaluate;
pub mod export;
pub mod field;
pub mod gaussians;
pub mod gpu;
pub mod losses;
mod matrix;
pub mod metrics;
pub mod motion;
pub mod optimiser;
pub mod raster;
pub mod reference;
pub mod scene;
pub mod schedule;
pub mod shaders;
pub mod sort;
pub mod static_set;
pub mod trainer;
pub mod trial;
