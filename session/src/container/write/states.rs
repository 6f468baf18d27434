//! The state of a stream's decoder, followed at little cost while recording.
//!
//! What a decoder of Prophesee's formats remembers is all said again within a few rows of events: the row, the base of
//! vectors, the low time; and of the high time it counts the rounds, which last 16.8 s and more. So it is enough to decode
//! the last kilobytes where a state is wanted, once a second and where a file ends. The DAVIS counts its time in wraps of 33 ms,
//! and is slow enough to be decoded whole.

use std::collections::VecDeque;

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
    /// Whether all packets are decoded as they come.
    whole: bool,
    /// Host time from which on the next state is due; `None` before the first packet.
    due_ns: Option<i64>,
    /// The last packets since the last cut, [`SAMPLE_BYTES`] of them and the rest of a packet: which are not decoded.
    recent: VecDeque<Packet>,
    recent_bytes: usize,
    /// Bytes from the last cut to the first of these packets, by which words lie.
    position: u64,
    /// Whether the decoder knows what lies before them.
    joined: bool,
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
        let (recent, recent_bytes) = (VecDeque::new(), 0);
        Some(Self { decoder, word, whole, due_ns: None, recent, recent_bytes, position: 0, joined: true, begun: false })
    }

    /// Lets the next packet have a state before it.
    pub fn want_state(&mut self) {
        if let Some(due_ns) = &mut self.due_ns {
            *due_ns = i64::MIN;
        }
    }

    /// Takes a packet. Gives the state of the decoder before it, if one is due.
    pub fn take(&mut self, packet: &Packet) -> Option<[u8; 16]> {
        let due_ns = *self.due_ns.get_or_insert(packet.host_ns.saturating_add(EVERY_NS));
        let due = packet.host_ns >= due_ns && !packet.discontinuity;
        let state = if due { self.state() } else { None };
        if state.is_some() {
            self.due_ns = Some(packet.host_ns.saturating_add(EVERY_NS));
        }
        if packet.discontinuity {
            // What lies before a cut is forgotten with it.
            self.forget(self.recent.len());
            (self.position, self.joined) = (0, true);
        }
        // Packets without a byte say nothing, and must not gather.
        if packet.discontinuity || !packet.payload.is_empty() {
            self.recent_bytes += packet.payload.len();
            self.recent.push_back(packet.clone());
        }
        // Rounds are counted from the first packet on.
        if self.whole || !self.begun {
            self.decode();
        }
        self.leave_out_old();
        state
    }

    /// Keeps as many of the last packets as a state needs.
    fn leave_out_old(&mut self) {
        while let Some(first) = self.recent.front()
            && self.recent_bytes - first.payload.len() >= SAMPLE_BYTES
        {
            self.forget(1);
            self.joined = false;
        }
    }

    /// The state behind the last packet.
    fn state(&mut self) -> Option<[u8; 16]> {
        self.decode();
        self.decoder.state()
    }

    /// Leaves the first packets out.
    fn forget(&mut self, count: usize) {
        for packet in self.recent.drain(..count) {
            self.recent_bytes -= packet.payload.len();
            self.position = self.position.wrapping_add(packet.payload.len() as u64);
        }
    }

    /// Decodes what was not decoded.
    fn decode(&mut self) {
        // After a gap, decoding goes on with the first whole word.
        let mut cut = 0;
        if !self.joined {
            self.decoder.restart();
            cut = ((self.word - self.position % self.word) % self.word) as usize;
        }
        for packet in &self.recent {
            hand_over(&mut self.decoder, packet, self.begun);
            let skipped = cut.min(packet.payload.len());
            self.decoder.decode(&packet.payload[skipped..], &mut Nowhere);
            (cut, self.begun) = (cut - skipped, true);
        }
        self.forget(self.recent.len());
        self.joined = true;
    }
}
