//! The session file: one MCAP file with everything that a rig delivered, byte for byte.
//!
//! `docs/session.md` describes the format for readers that are not this program.

mod error;
pub mod packet;
pub mod record;
mod writer;

pub use error::ContainerError;
pub use record::{IncidentEntry, SessionStart, Status, StreamStatus, StreamTotals};
pub use writer::{Finished, SessionWriter, Settings, StreamId};
