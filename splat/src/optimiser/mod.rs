//! Adam on the device, and the check that numbers are still numbers.

mod adam;
mod finite;
mod rate;
#[cfg(test)]
mod tests;

pub use adam::{Adam, AdamBuffers, AdamConfig};
pub use finite::FiniteCheck;
pub use rate::decayed;
