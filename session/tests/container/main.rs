//! The session file, against the reader of the `mcap` crate and against damage.

mod common;
mod write;
