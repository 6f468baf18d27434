//! What tests of USB drivers share.

mod bucket;
mod bus;
mod clock;
pub mod davis346;
pub mod evk4;
mod host_clock;

pub use bucket::Bucket;
pub use bus::{Clock, EmulatedBus};
pub use clock::simulated;
pub use host_clock::HostClock;
