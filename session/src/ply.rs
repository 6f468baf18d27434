//! Coloured point clouds in PLY files.

use std::path::{Path, PathBuf};

/// Points with colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions, metres.
    pub positions: Vec<[f32; 3]>,
    /// Colours, red, green, blue, sRGB-encoded; as many as positions.
    pub colours: Vec<[u8; 3]>,
}

/// What can go wrong with a PLY file.
#[derive(Debug, thiserror::Error)]
pub enum PlyError {
    /// The file cannot be opened, read or written.
    #[error("cannot {doing} point cloud {}: {source}", path.display())]
    Io {
        /// `read` or `write`.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

impl PointCloud {
    /// How many points there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Reads vertices `x`, `y`, `z` and `red`, `green`, `blue` (grey where absent) of an ASCII or binary little-endian
    /// PLY file. Other properties and elements are skipped.
    ///
    /// # Errors
    /// If the file is missing, cut short, malformed, or a coordinate is not finite.
    pub fn read(path: &Path) -> Result<Self, PlyError> {
        todo!("{path:?}")
    }

    /// Writes a binary little-endian PLY file with float positions and uchar colours.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), PlyError> {
        todo!("{path:?}")
    }
}
