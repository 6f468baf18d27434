//! The state of a stream's decoder, followed at little cost while recording.
//!
//! What a decoder of Prophesee's formats remembers is all said again within a few rows of events: the row, the base of
//! vectors, the low time; and of the high time it counts the rounds, which last 16.8 s and more. So it is enough to decode
//! some kilobytes before each state, once a second. The DAVIS counts its time in wraps of 33 ms, and is slow enough to be
//! decoded whole.

use crate::{
    container::read::{Nowhere, hand_over, sensor_size},
    source::{Description, Packet},
};
use erfgs_events::EventEncoding;
use erfgs_events::{Decoder, StreamDecoder};

/// From one state to the next, nanoseconds of host time.
const EVERY_NS: i64 = 1_000_000_000;
/// So many bytes are decoded before a state.
const SAMPLE_BYTES: usize = 16 << 10;

pub(super) struct StateKeeper {
    decoder: StreamDecoder,
    /// Bytes of a word of the format.
    word: u64,
    /// Whether all packets are decoded.
    whole: bool,
    /// Host time from which on the next state is due.
    due_ns: Option<i64>,
    /// Bytes decoded without a gap up to here.
    sampled: usize,
    /// Bytes since the last cut, by which words lie.
    position: u64,
    begun: bool,
}

impl StateKeeper {
    /// For a stream of events that erfgs decodes.
    pub fn new(description: &Description) -> Option<Self> {
        let encoding = description.encoding.events()?;
        let decoder = StreamDecoder::new(encoding, sensor_size(description));
        // What has no state needs none: it can be decoded from any packet on.
        decoder.state()?;
        let word = match encoding {
            EventEncoding::Evt21 | EventEncoding::Evt21Legacy => 8,
            EventEncoding::Evt2 => 4,
            _ => 2,
        };
        let whole = encoding == EventEncoding::Davis;
        Some(Self { decoder, word, whole, due_ns: None, sampled: 0, position: 0, begun: false })
    }

    /// Takes a packet. Gives the state of the decoder before it, if one is due.
    pub fn take(&mut self, packet: &Packet) -> Option<[u8; 16]> {
        let due_ns = *self.due_ns.get_or_insert(packet.host_ns.saturating_add(EVERY_NS));
        let due = packet.host_ns >= due_ns;
        let state = (due && !packet.discontinuity && (self.whole || self.sampled >= SAMPLE_BYTES))
            .then(|| self.decoder.state())
            .flatten();
        if state.is_some() {
            self.due_ns = Some(packet.host_ns.saturating_add(EVERY_NS));
            self.sampled = 0;
        }
        if packet.discontinuity {
            (self.sampled, self.position) = (0, 0);
        }
        if self.whole || (due && state.is_none()) || !self.begun {
            hand_over(&mut self.decoder, packet, self.begun);
            self.decode(&packet.payload);
        } else {
            self.sampled = 0;
        }
        self.position = self.position.wrapping_add(packet.payload.len() as u64);
        state
    }

    fn decode(&mut self, payload: &[u8]) {
        // After a gap, decoding goes on with the first whole word.
        let after_gap = self.sampled == 0 && self.begun && !self.whole;
        let cut = if after_gap { ((self.word - self.position % self.word) % self.word) as usize } else { 0 };
        if after_gap {
            self.decoder.restart();
        }
        let rest = payload.get(cut..).unwrap_or_default();
        self.decoder.decode(rest, &mut Nowhere);
        self.sampled += rest.len();
        self.begun = true;
    }
}
