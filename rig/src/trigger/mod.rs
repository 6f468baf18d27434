//! The trigger board: its line protocol over a serial port, and the code on its pulse train.

pub mod code;
mod config;
mod error;
mod find;
mod link;
pub mod protocol;
mod source;

pub use config::{Led, TriggerConfig, TriggerSettings};
pub use error::TriggerError;
pub use find::{FoundBoard, find, ports};
pub use link::Link;
pub use source::TriggerBoard;
