//! Exclusive prefix sums (reduce, scan, apply).

use wgpu::Buffer;

use super::{BLOCK, Plan, SHARED};
use crate::gpu::{Bound, Commands, Gpu, GpuError, Kernel, stored};

const SCAN_SHARED: &str = include_str!("scan_shared.wgsl");

/// The kernels of a prefix sum.
#[derive(Debug)]
pub struct PrefixSum {
    reduce: Kernel,
    sums: Kernel,
    apply: Kernel,
    whole: Kernel,
}

/// As many numbers one workgroup adds up while three kernels would still be waiting for each other.
const FEW: u32 = 8 * BLOCK;

/// What a prefix sum works with.
#[derive(Debug)]
pub struct ScanBuffers {
    sums: Buffer,
}

impl ScanBuffers {
    /// Room for a prefix sum of `count` numbers.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &Gpu, count: u32) -> Result<Self, GpuError> {
        Ok(Self { sums: gpu.storage("prefix sum", Self::bytes(count))? })
    }

    /// Bytes of it.
    #[must_use]
    pub fn bytes(count: u32) -> u64 {
        stored(4 * u64::from(count.div_ceil(BLOCK)))
    }
}

impl PrefixSum {
    /// Compiles the kernels.
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            reduce: gpu.kernel("scan reduce", &[SHARED, SCAN_SHARED, include_str!("scan_reduce.wgsl")]),
            sums: gpu.kernel("scan sums", &[SHARED, SCAN_SHARED, include_str!("scan_sums.wgsl")]),
            apply: gpu.kernel("scan apply", &[SHARED, SCAN_SHARED, include_str!("scan_apply.wgsl")]),
            whole: gpu.kernel("scan whole", &[SHARED, SCAN_SHARED, include_str!("scan_whole.wgsl")]),
        }
    }

    /// Replaces each of the first `plan.scanned` numbers by the sum of those before it, and leaves the sum of all in
    /// `plan.total`. Sums saturate at 2^32 - 1. `plan` holds a [`Plan`].
    pub fn record(&self, commands: &mut Commands<'_>, plan: &Buffer, numbers: &Buffer, buffers: &ScanBuffers) {
        commands.dispatch_indirect(&self.reduce, &[plan, numbers, &buffers.sums], plan, Plan::SCAN_GROUPS);
        commands.dispatch(&self.sums, &[plan, &buffers.sums], 1);
        commands.dispatch_indirect(&self.apply, &[plan, &buffers.sums, numbers], plan, Plan::SCAN_GROUPS);
    }

    /// A prefix sum of the first `plan.scanned` numbers, `most` at most, that is run again and again; it leaves no sum of all.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        plan: &Buffer,
        numbers: &Buffer,
        buffers: &ScanBuffers,
        most: u32,
    ) -> BoundScan {
        if most <= FEW {
            return BoundScan::Whole(gpu.bind(&self.whole, &[plan, numbers]));
        }
        BoundScan::Steps(
            [
                gpu.bind(&self.reduce, &[plan, numbers, &buffers.sums]),
                gpu.bind(&self.sums, &[plan, &buffers.sums]),
                gpu.bind(&self.apply, &[plan, &buffers.sums, numbers]),
            ]
            .into(),
        )
    }
}

/// See [`PrefixSum::bind`].
#[derive(Debug)]
pub(super) enum BoundScan {
    /// Few numbers, by one workgroup.
    Whole(Bound),
    /// Reduce, scan, apply.
    Steps(Box<[Bound; 3]>),
}

impl BoundScan {
    pub(super) fn record(&self, commands: &mut Commands<'_>, plan: &Buffer) {
        match self {
            Self::Whole(whole) => commands.run(whole, 1),
            Self::Steps(steps) => {
                let [reduce, sums, apply] = &**steps;
                commands.run_indirect(reduce, plan, Plan::SCAN_GROUPS);
                commands.run(sums, 1);
                commands.run_indirect(apply, plan, Plan::SCAN_GROUPS);
            }
        }
    }
}
