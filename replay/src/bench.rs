//! The simulator's speed.

use serde::Serialize;

use crate::simulator::{SimulatorConfig, SimulatorError};

/// How fast the simulator was.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Pixels processed: width times height times frames.
    pub pixels: u64,
    /// Events made.
    pub events: u64,
    /// Threads used.
    pub threads: usize,
    /// Wall time of the fastest run, seconds.
    pub seconds: f64,
    /// Million pixels a second on each thread.
    pub mpix_per_s_per_core: f64,
    /// Million events a second.
    pub mevents_per_s: f64,
}

/// Simulates `luma` (frames of `width` x `height` grey levels) at `fps` frames a second `runs` times on `threads` threads.
///
/// # Errors
/// If the simulator refuses the frames or its configuration.
pub fn simulate(
    luma: &[u8],
    width: u32,
    height: u32,
    fps: f64,
    config: &SimulatorConfig,
    threads: usize,
    runs: u32,
) -> Result<Figures, SimulatorError> {
    todo!("{} {width} {height} {fps} {config:?} {threads} {runs}", luma.len())
}

/// Frames of a textured background before which a textured disc moves, for measuring without a recording.
#[must_use]
pub fn moving_disc(width: u32, height: u32, frames: u32) -> Vec<u8> {
    todo!("{width} {height} {frames}")
}
