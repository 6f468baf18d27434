//! A stable least-significant-digit radix sort of u32 keys with u32 values, four bits a pass.

use wgpu::Buffer;

use super::{BLOCK, DIGITS, Plan, PrefixSum, SHARED, ScanBuffers, scan::BoundScan};
use crate::gpu::{Bound, Commands, Gpu, GpuError, Kernel, stored};

/// The kernels of the sort.
#[derive(Debug)]
pub struct RadixSort {
    count: Kernel,
    scatter: Kernel,
    shifts: [Buffer; 8],
    /// The prefix sum that it works with.
    pub prefix_sum: PrefixSum,
}

/// Keys and values, and what the sort works with.
#[derive(Debug)]
pub struct SortBuffers {
    /// What is sorted by, ascending: a `u32` each.
    pub keys: Buffer,
    /// What goes with each key: a `u32`.
    pub values: Buffer,
    /// How many there are: a [`Plan`] for a sort.
    pub plan: Buffer,
    /// Pairs that there is room for.
    pub capacity: u32,
    passes: Vec<Pass>,
}

/// One digit's kernels, bound.
#[derive(Debug)]
struct Pass {
    count: Bound,
    scan: BoundScan,
    scatter: Bound,
}

impl RadixSort {
    /// Compiles the kernels.
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            count: gpu.kernel("radix count", &[SHARED, include_str!("radix_count.wgsl")]),
            scatter: gpu.kernel("radix scatter", &[SHARED, include_str!("radix_scatter.wgsl")]),
            shifts: std::array::from_fn(|pass| gpu.uniform("radix shift", &[4 * pass as u32, 0, 0, 0])),
            prefix_sum: PrefixSum::new(gpu),
        }
    }

    /// Room for `capacity` pairs.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn buffers(&self, gpu: &Gpu, label: &str, capacity: u32) -> Result<SortBuffers, GpuError> {
        let (each, most) = SortBuffers::sizes(capacity);
        let pairs = |what: &str| gpu.storage(&format!("{label} {what}"), each);
        let near = [pairs("keys")?, pairs("values")?];
        let far = [pairs("other keys")?, pairs("other values")?];
        let plan = gpu.storage(&format!("{label} plan"), size_of::<Plan>() as u64)?;
        let counts = gpu.storage(&format!("{label} counts"), 4 * u64::from(most))?;
        let scan = ScanBuffers::new(gpu, most)?;
        let bind = |(shift, pass): (&Buffer, usize)| {
            let ([keys, values], [to_keys, to_values]) = if pass % 2 == 0 { (&near, &far) } else { (&far, &near) };
            Pass {
                count: gpu.bind(&self.count, &[&plan, shift, keys, &counts]),
                scan: self.prefix_sum.bind(gpu, &plan, &counts, &scan, most),
                scatter: gpu.bind(&self.scatter, &[&plan, shift, keys, values, &counts, to_keys, to_values]),
            }
        };
        let passes = self.shifts.iter().zip(0..).map(bind).collect();
        let [keys, values] = near;
        Ok(SortBuffers { keys, values, plan, capacity, passes })
    }
}

impl SortBuffers {
    /// Bytes of the keys or values of so many pairs, and how many counts there are.
    fn sizes(capacity: u32) -> (u64, u32) {
        (4 * u64::from(capacity), DIGITS * capacity.div_ceil(BLOCK))
    }

    /// Bytes of all buffers with room for so many pairs.
    #[must_use]
    pub fn bytes(capacity: u32) -> u64 {
        let (each, most) = Self::sizes(capacity);
        4 * stored(each) + stored(size_of::<Plan>() as u64) + stored(4 * u64::from(most)) + ScanBuffers::bytes(most)
    }

    /// Sorts the first `plan.count` pairs by the lowest `bits` bits of their keys, in place; equal keys keep their
    /// order. `known` is their count where the host knows it.
    pub fn sort(&self, commands: &mut Commands<'_>, bits: u32, known: Option<u32>) {
        // A workgroup for each block of pairs.
        let by_block = |commands: &mut Commands<'_>, bound: &Bound| match known {
            Some(pairs) => commands.run(bound, pairs.div_ceil(BLOCK)),
            None => commands.run_indirect(bound, &self.plan, Plan::BLOCK_GROUPS),
        };
        // An even number of passes ends where it began.
        let passes = bits.div_ceil(4).next_multiple_of(2).min(8) as usize;
        for Pass { count, scan, scatter } in &self.passes[..passes] {
            by_block(commands, count);
            scan.record(commands, &self.plan);
            by_block(commands, scatter);
        }
    }
}
