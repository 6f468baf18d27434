//! The decoding of one stream: how it begins, and what came of it.

use erfgs_events::{Anomalies, StreamDecoder};

/// What came of decoding.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DecodedStream {
    /// Packets that were decoded.
    pub packets: u64,
    /// Bytes of their payloads.
    pub bytes: u64,
    /// What was wrong with them.
    pub anomalies: Anomalies,
    /// Damaged places of the file that were passed over.
    pub damage: Vec<String>,
}

/// A decoder, and where it goes on.
pub struct BegunDecoder {
    /// The decoder.
    pub decoder: StreamDecoder,
    /// The number of the first packet that it wants.
    pub first_sequence: u64,
    /// When that packet arrived, host time, nanoseconds; `None` for the beginning.
    pub host_ns: Option<i64>,
}
