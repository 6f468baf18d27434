//! The trigger board: its line protocol over a serial port, and the code on its pulse train.

pub mod code;
pub mod protocol;
