//! What the fuzz targets have in common: how an input is taken apart, and what must hold for every decoder.
//!
//! - Where the pieces of a stream begin and end changes neither events nor anomalies.
//! - Events lie on the sensor.
//! - Memory grows with the bytes that came, and not with what they claim.

mod check;
pub mod memory;
mod plan;
mod trickle;

pub use check::{Nothing, check_device, check_resumed, check_stream};
pub use plan::Plan;
pub use trickle::Trickle;
