//! The device that every kernel runs on: adapter choice, buffers, kernels, command recording.
//!
//! Kernels have two shapes (see [`Shape`]). The GPU shape uses workgroups of 256 threads and shared memory. The CPU
//! shape, for software adapters such as lavapipe, gives each thread several pixels and uses no barriers; on such
//! adapters matrix products and sorting run on the host, on buffers that are mapped in place.

mod canary;
mod commands;
mod context;
mod kernel;
mod memory;
mod reuse;
mod submissions;
mod timing;
mod traffic;

pub use canary::{Canary, run_canary};
pub use commands::Commands;
pub use context::{AdapterChoice, Gpu, GpuError, Shape, adapters};
pub use kernel::{Binding, Bound, Kernel};
pub use memory::stored;
pub use submissions::{HeldBack, Submission};
pub use timing::KernelTime;
pub use traffic::Traffic;
