//! What a recording holds: its streams, and the messages of them.

use super::record::{IncidentEntry, Status, StreamTotals};
use crate::{
    clock::ClockFit,
    source::{Description, Packet},
};

/// One stream of a session.
#[derive(Clone, Debug, PartialEq)]
pub struct Stream {
    /// What it is.
    pub description: Description,
    /// The topic of its packets.
    pub topic: String,
    /// What the file holds of it.
    pub totals: StreamTotals,
}

/// One message of a session.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry {
    /// A packet of a stream.
    Packet {
        /// Which stream: an index into [`super::Summary::streams`].
        stream: usize,
        /// What the device sent, and when it arrived.
        packet: Packet,
    },
    /// The state of a stream's decoder before a packet.
    DecoderState(DecoderState),
    /// The state of the recorder.
    Status(Status),
    /// Something that happened.
    Incident(IncidentEntry),
    /// A clock fit, as known while recording.
    Clock {
        /// The stream's id.
        stream: String,
        /// From the device's ticks to session time.
        fit: ClockFit,
    },
}

/// The state of a stream's decoder before a packet, so that decoding can start there.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct DecoderState {
    /// The stream's id.
    pub stream: String,
    /// Host time of the packet, nanoseconds.
    pub host_ns: i64,
    /// The packet's sequence number.
    pub sequence: u64,
    /// The state: what the decoder's `state()` gave.
    pub state: [u8; 16],
}
