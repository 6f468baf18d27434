//! A check that the driver runs long loops to their end. Mesa before 24 stops all loops of an invocation after 65,535
//! iterations in total, without an error.

use super::{Gpu, GpuError};

const LOOPS: &str = "
@group(0) @binding(0) var<storage, read_write> result: array<u32>;
@compute @workgroup_size(1) fn main() {
    for (var i = 0u; i < 70000u; i++) { result[0] = result[0] + 1u; }
    for (var i = 0u; i < 300u; i++) { for (var j = 0u; j < 300u; j++) { result[1] = result[1] + 1u; } }
}";

/// What the canary counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Canary {
    /// Iterations of a loop of 70,000.
    pub single_loop: u32,
    /// Iterations of nested loops of 300 x 300.
    pub nested_loops: u32,
}

impl Canary {
    /// Whether the driver counted right.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.single_loop == 70_000 && self.nested_loops == 90_000
    }
}

/// Runs the canary.
///
/// # Errors
/// [`GpuError::BrokenDriver`] where a loop ended early, [`GpuError::Failed`] where it did not run.
pub fn run_canary(gpu: &Gpu) -> Result<Canary, GpuError> {
    let kernel = gpu.kernel("canary", &[LOOPS]);
    let result = gpu.storage("canary", 8)?;
    let mut commands = gpu.commands();
    commands.dispatch(&kernel, &[&result], 1);
    commands.submit();
    let counts: Vec<u32> = gpu.download(&result, 2)?;
    let canary = Canary { single_loop: counts[0], nested_loops: counts[1] };
    if canary.is_alive() {
        return Ok(canary);
    }
    Err(GpuError::BrokenDriver {
        adapter: gpu.info.name.clone(),
        driver: gpu.info.driver_info.clone(),
        finding: format!(
            "a loop of 70,000 iterations ran {} times, nested loops of 90,000 ran {} times",
            canary.single_loop, canary.nested_loops
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::AdapterChoice;

    #[test]
    fn the_driver_runs_long_loops_to_their_end() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        run_canary(&gpu).expect("a driver that computes correctly");
    }

    #[test]
    fn a_wgsl_error_is_reported_and_does_not_panic() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        let bytes = gpu.storage("x", 16).expect("a buffer");
        let _kernel = gpu.kernel("broken", &["this is not WGSL"]);
        assert!(matches!(gpu.wait("compiling"), Err(GpuError::Failed { .. })));
        assert_eq!(gpu.download::<u32>(&bytes, 4).expect("still alive"), [0; 4]);
    }
}
