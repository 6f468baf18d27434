//! The trigger board: its line protocol over a serial port.

mod config;
mod error;
mod find;
mod link;
mod source;

pub use config::{Led, TriggerConfig, TriggerSettings};
pub use error::TriggerError;
pub use find::{FoundBoard, find, ports};
pub use link::Link;
pub use source::TriggerBoard;
