//! What must hold for any bytes that a decoder, a reader of files or the session file is given.
//!
//! - Where the pieces of a stream begin and end changes neither events nor anomalies.
//! - Events lie on the sensor.
//! - Memory grows with the bytes that came, and not with what they claim.
//!
//! A target checks one input ([`TARGETS`]); [`seeds`] gives small inputs that mean something, and [`mutation`] changes
//! them. The tests of this crate run so many mutations of them each time; `scripts/fuzz.sh` has libFuzzer make up inputs for as
//! long as it is told to (`libfuzzer`).

mod check;
pub mod memory;
mod mutate;
mod plan;
mod seeds;
mod targets;
mod trickle;

pub use check::{Nothing, check_device, check_resumed, check_stream};
pub use mutate::mutation;
pub use plan::Plan;
pub use seeds::seeds;
pub use targets::{TARGETS, Target, target};
pub use trickle::Trickle;
