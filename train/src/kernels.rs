//! The kernels of learning.

use erfgs_splat::gpu::{Gpu, Kernel};

/// Compiles a kernel of this crate; see [`Gpu::trusted_kernel`].
#[expect(unsafe_code, reason = "a test reads the loops of this crate's kernels")]
pub(crate) fn kernel(gpu: &Gpu, label: &str, parts: &[&str]) -> Kernel {
    // SAFETY: Each loop of this crate's kernels counts towards a bound, which a test reads off them (`tests/rooms/kernels.rs`).
    unsafe { gpu.trusted_kernel(label, parts) }
}

/// Pixels that a thread of a summing kernel looks at.
const PIXELS_A_THREAD: u32 = 16;

/// Threads of a kernel that sums over `pixels` pixels.
pub(crate) fn threads_for(pixels: u32) -> u32 {
    pixels.div_ceil(PIXELS_A_THREAD).max(1)
}
