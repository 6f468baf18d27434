//! Codecs of event streams: one state machine for each format, fed with bytes in pieces of any size.

mod sink;

pub use sink::{ApsFrame, CdEvent, Edge, ImuSample, Sink};
