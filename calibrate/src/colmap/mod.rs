//! COLMAP, driven: its program or pycolmap, its database, and matching along known epipolar lines in its place.

pub(crate) mod brute;
mod choice;
pub(crate) mod database;
mod error;
pub(crate) mod matching;
mod process;
mod program;
mod steps;

pub use choice::ColmapProgram;
pub use error::RunError;
pub use program::Colmap;
pub(crate) use steps::{Extraction, Mapping, Triangulation, Verification};
