//! Registers every viewpoint in one frame, and makes the initial point cloud.
//!
//! [`cloud`] turns the frames of a dataset with known poses into coloured 3D points: through COLMAP with matching that
//! uses the poses, through a dense plane sweep, or at random. [`sfm`] finds the poses themselves from images.

pub mod board;
pub mod bundle;
pub mod check;
pub mod cloud;
pub mod colmap;
pub mod convert;
mod coverage;
pub mod evidence;
pub mod geometry;
pub mod intensity;
pub mod report;
pub mod rig_file;
pub mod sfm;
mod statistics;
pub mod wand;

pub use cloud::{
    Cloud, CloudError, CloudOptions, CloudPoint, Colmap, ColmapOptions, ColmapProgram, FrameChoice, MatchOptions,
    Method, Progress, Stage, SweepOptions, attach, initial_cloud,
};
