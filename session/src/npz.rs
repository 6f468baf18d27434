//! Events and luma sequences in NumPy's `.npz` archives.

use std::path::{Path, PathBuf};

use crate::Events;

/// What can go wrong with an `.npz` file.
#[derive(Debug, thiserror::Error)]
pub enum NpzError {
    /// The file cannot be opened, read or written.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// `read` or `write`.
        doing: &'static str,
        /// The archive.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// A sequence of grey frames: `data` holds `frames` images of `height` rows of `width` values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LumaSequence {
    /// Number of frames.
    pub frames: usize,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `frames * height * width` bytes.
    pub data: Vec<u8>,
}

/// Reads events: arrays `t` or `t_us` (microseconds, any integer type), `x`, `y`, `p` (1 = ON).
///
/// `size` is the sensor's width and height in pixels; without it the archive must hold `width` and `height`, as those
/// that [`write_events`] makes do.
///
/// # Errors
/// If the file is missing, cut short or malformed, the columns differ in length, times decrease, or an event lies
/// outside the sensor.
pub fn read_events(path: &Path, size: Option<[u32; 2]>) -> Result<Events, NpzError> {
    todo!("{path:?} {size:?}")
}

/// Writes events: `t` (i64, microseconds), `x` and `y` (u16), `p` (u8, 1 = ON), `width` and `height` (u32 scalars).
/// The file appears whole or not at all; the same events give the same bytes.
///
/// # Errors
/// If the file cannot be written.
pub fn write_events(path: &Path, events: &Events) -> Result<(), NpzError> {
    todo!("{path:?} {events:?}")
}

/// Reads `luma[T, H, W]` (u8).
///
/// # Errors
/// If the file is missing, cut short or malformed.
pub fn read_luma(path: &Path) -> Result<LumaSequence, NpzError> {
    todo!("{path:?}")
}
