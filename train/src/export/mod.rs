//! Standard 3DGS point clouds: what other viewers and tools read.

mod header;
mod ply;

pub use ply::{read_ply, write_ply};

use std::{io, path::PathBuf};

/// What can go wrong with point clouds.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The rows do not fit together.
    #[error(
        "the SH rows of {count} Gaussians of degree {sh_degree} need {expected} values, but {found} were given; make them with Gaussians::with_sh_degree"
    )]
    Length {
        /// Gaussians.
        count: usize,
        /// SH degree.
        sh_degree: u32,
        /// Values needed.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// The SH degree is not supported.
    #[error("SH degree {0} is not supported; use 0, 1, 2 or 3")]
    ShDegree(u32),
    /// The file could not be read.
    #[error("could not read point cloud '{}': {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file could not be written.
    #[error("could not write point cloud '{}': {source}; check the free space and the permissions", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is not a 3DGS point cloud.
    #[error("'{}' is not a 3DGS point cloud: {message}; export it as a binary little-endian 3DGS .ply", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// The file ends early.
    #[error("'{}' is cut short: it holds {complete} of {count} Gaussians; export it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Gaussians that the header promises.
        count: usize,
        /// Gaussians that are there whole.
        complete: usize,
    },
}
