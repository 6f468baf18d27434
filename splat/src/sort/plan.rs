//! How much there is to scan or to sort.

use bytemuck::{Pod, Zeroable};

use super::{BLOCK, DIGITS};

/// `Plan` in WGSL. A kernel that knows the size on the device fills in the same fields.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Plan {
    /// Pairs to sort.
    pub count: u32,
    /// Blocks of pairs.
    pub blocks: u32,
    /// Numbers to scan.
    pub scanned: u32,
    /// Blocks of numbers.
    pub scan_blocks: u32,
    /// Workgroups, one a block of pairs; the last is unused.
    pub block_groups: [u32; 4],
    /// Workgroups, one a block of numbers; the last is unused.
    pub scan_groups: [u32; 4],
    /// Sum of what was scanned last, up to 2^32 - 1; the rest is unused.
    pub total: [u32; 4],
}

impl Plan {
    /// Where `block_groups` lies, bytes.
    pub const BLOCK_GROUPS: u64 = 16;
    /// Where `scan_groups` lies, bytes.
    pub const SCAN_GROUPS: u64 = 32;

    /// For a sort of `count` pairs.
    #[must_use]
    pub fn sort(count: u32) -> Self {
        let blocks = count.div_ceil(BLOCK);
        Self { count, blocks, block_groups: groups(blocks), ..Self::scan(DIGITS * blocks) }
    }

    /// For a prefix sum of `count` numbers.
    #[must_use]
    pub fn scan(count: u32) -> Self {
        let blocks = count.div_ceil(BLOCK);
        Self { scanned: count, scan_blocks: blocks, scan_groups: groups(blocks), ..Self::default() }
    }
}

/// Workgroups in two dimensions, at most 65,535 along each.
fn groups(count: u32) -> [u32; 4] {
    if count > 65_535 { [32_768, count.div_ceil(32_768), 1, 0] } else { [count, 1, 1, 0] }
}
