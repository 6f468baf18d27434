//! USB3 Vision: cameras on USB.
//!
//! [`gencp`] and [`stream`] are the protocols, without input or output; `control` speaks the first over a USB transport, `device`
//! receives the second.
//!
//! Both are our own. A crate has them (viva-u3v), but they are small, every byte of them comes from a camera and is to be fuzzed here,
//! and a status or a count that is wrong has to become a message of ours.

mod control;
mod device;
mod find;
pub mod gencp;
mod sizes;
pub mod stream;

pub use control::Channel;
pub use device::{Device, Intake};
pub use find::{Found, find};
pub use sizes::Sizes;
