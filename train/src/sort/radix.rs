//! A stable least-significant-digit radix sort of u32 keys with u32 values, four bits a pass.

use wgpu::Buffer;

use super::{BLOCK, DIGITS, Plan, PrefixSum, SHARED, ScanBuffers};
use crate::gpu::{Commands, Gpu, GpuError, Kernel};

/// The kernels of the sort.
#[derive(Debug)]
pub struct RadixSort {
    count: Kernel,
    scatter: Kernel,
    shifts: [Buffer; 8],
}

/// Keys and values, and what the sort works with.
#[derive(Debug)]
pub struct SortBuffers {
    /// What is sorted by, ascending: a `u32` each.
    pub keys: Buffer,
    /// What goes with each key: a `u32`.
    pub values: Buffer,
    other_keys: Buffer,
    other_values: Buffer,
    counts: Buffer,
    scan: ScanBuffers,
    /// Pairs that there is room for.
    pub capacity: u32,
}

impl SortBuffers {
    /// Room for `capacity` pairs.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &Gpu, label: &str, capacity: u32) -> Result<Self, GpuError> {
        let pairs = |what: &str| gpu.storage(&format!("{label} {what}"), 4 * u64::from(capacity));
        let counts = DIGITS * capacity.div_ceil(BLOCK);
        Ok(Self {
            keys: pairs("keys")?,
            values: pairs("values")?,
            other_keys: pairs("other keys")?,
            other_values: pairs("other values")?,
            counts: gpu.storage(&format!("{label} counts"), 4 * u64::from(counts))?,
            scan: ScanBuffers::new(gpu, counts)?,
            capacity,
        })
    }
}

impl RadixSort {
    /// Compiles the kernels.
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            count: gpu.kernel("radix count", &[SHARED, include_str!("radix_count.wgsl")]),
            scatter: gpu.kernel("radix scatter", &[SHARED, include_str!("radix_scatter.wgsl")]),
            shifts: std::array::from_fn(|pass| gpu.uniform("radix shift", &[4 * pass as u32, 0, 0, 0])),
        }
    }

    /// Sorts the first `plan.count` pairs by the lowest `bits` bits of their keys, in place; equal keys keep their
    /// order. `plan` holds a [`Plan`] for a sort.
    pub fn record(
        &self,
        commands: &mut Commands<'_>,
        prefix_sum: &PrefixSum,
        plan: &Buffer,
        buffers: &SortBuffers,
        bits: u32,
    ) {
        // An even number of passes ends where it began.
        let passes = bits.div_ceil(4).next_multiple_of(2).min(8) as usize;
        for (pass, shift) in self.shifts.iter().take(passes).enumerate() {
            let near = (&buffers.keys, &buffers.values);
            let far = (&buffers.other_keys, &buffers.other_values);
            let (from, to) = if pass % 2 == 0 { (near, far) } else { (far, near) };
            let at = Plan::BLOCK_GROUPS;
            commands.dispatch_indirect(&self.count, &[plan, shift, from.0, &buffers.counts], plan, at);
            prefix_sum.record(commands, plan, &buffers.counts, &buffers.scan);
            let bindings = [plan, shift, from.0, from.1, &buffers.counts, to.0, to.1];
            commands.dispatch_indirect(&self.scatter, &bindings, plan, at);
        }
    }
}
