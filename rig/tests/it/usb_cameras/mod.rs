//! The drivers of USB event cameras against the emulated cameras, in this process.

mod davis346;
mod davis346_stream;
mod evk4;
mod evk4_settings;
pub mod support;
mod sync;
