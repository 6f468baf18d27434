//! Prefix sums and a stable radix sort on the device, for the GPU shape. They use neither subgroups nor float atomics,
//! and their sizes may be known to the device alone.

mod plan;
mod radix;
mod scan;

pub use plan::Plan;
pub use radix::{RadixSort, SortBuffers};
pub use scan::{PrefixSum, ScanBuffers};

/// WGSL that all stages share.
pub(crate) const SHARED: &str = include_str!("shared.wgsl");
/// Elements of a workgroup.
const BLOCK: u32 = 2048;
/// Values of a digit.
const DIGITS: u32 = 16;

#[cfg(test)]
mod tests;
