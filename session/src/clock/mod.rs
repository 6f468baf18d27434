//! Clocks of devices, and the lines that take their ticks to the session clock.
//!
//! A device counts ticks of its own: microseconds in an event camera, 62.5 ns in the trigger board. They stay as
//! recorded. A [`ClockFit`] says what they mean: nanoseconds on the session clock, which is the host's monotonic clock
//! with its zero where the recording started. A [`Clock`] is one such line, or a chain of them where the rate drifts. A device
//! that restarts while it is recorded has a clock for each of its [`Epochs`].

mod dated;
mod epochs;
mod exposure;
mod fit;
mod line;
mod pieces;
#[cfg(test)]
mod tests;

pub use dated::Dated;
pub use epochs::{Epoch, EpochCursor, Epochs};
pub use exposure::Exposure;
pub use fit::{ClockFit, Evidence, FitError, Residuals, Sample};
pub use line::{CRYSTAL_PPM, RESONATOR_PPM, Robust};
pub use pieces::{Clock, Errors};
