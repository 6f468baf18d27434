//! The session file of a rig: what every device delivered, byte for byte, in one MCAP file, and what it takes to read it.
//!
//! Times are `i64` nanoseconds on the session clock, which is the host's monotonic clock with its zero where the recording
//! started.

pub mod clock;
pub mod container;
mod encoding;
pub mod export;
pub mod source;
pub mod trigger;

pub use container::{Recording, Session, SessionWriter};
