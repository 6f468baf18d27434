//! What tests of USB drivers share.

mod bucket;
mod bus;
mod clock;
pub mod davis346;
pub mod evk4;

pub use bucket::Bucket;
pub use bus::{Clock, EmulatedBus};
pub use clock::simulated;
