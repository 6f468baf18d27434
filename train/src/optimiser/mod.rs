//! Adam on the device, and the check that numbers are still numbers.

mod adam;
mod cautious;
mod finite;
#[cfg(test)]
mod tests;

pub use adam::{Adam, AdamBuffers, AdamConfig};
pub(crate) use cautious::cautious_step;
pub use finite::FiniteCheck;
