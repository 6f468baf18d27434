//! The trigger board's words: the lines of its protocol, and the code on its pulse train.

pub mod code;
pub mod protocol;
