//! The tile rasteriser, forward and backward.

mod buffers;

pub use buffers::Deltas;
