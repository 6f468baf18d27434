//! COLMAP, driven: its program or pycolmap, its database, and matching along known epipolar lines in its place.

pub mod brute;
mod choice;
pub mod database;
mod error;
pub mod matching;
mod output;
mod program;
mod steps;

pub use choice::ColmapProgram;
pub use error::RunError;
pub use program::Colmap;
pub use steps::{Extraction, Mapping, Triangulation, Verification};
