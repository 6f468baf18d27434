//! The events of one stream as packets of EVT 3: as the sensor sent them, or encoded anew.

use erfgs_events::{ApsFrame, CdEvent, Decoder, Edge, EncodeError, Evt3Encoder, Sink, StreamDecoder};
use erfgs_session::{
    container::{BegunDecoder, hand_over},
    source::Packet,
};
use erfgs_sync::reading::Dater;

/// After so many microseconds the clock of EVT 3 begins anew, and readers count from its first round on.
const EVT3_ROUND_US: u64 = 1 << 24;

/// What a packet holds.
pub struct Held {
    /// Session time of its first event, nanoseconds, where a clock tells it.
    pub first_ns: Option<i64>,
    /// Whether it has events.
    pub seen: bool,
    /// Its words of EVT 3; `None` where those of the packet are.
    pub words: Option<Vec<u8>>,
    /// Frames of the sensor's own pixels, and the middles of their exposures.
    pub frames: Vec<(ApsFrame, Option<i64>)>,
}

/// A stream that is read packet by packet.
pub struct Reading {
    decoder: StreamDecoder,
    first_sequence: u64,
    begun: bool,
    dater: Dater,
    anew: Option<Anew>,
}

impl Reading {
    /// `as_sent`: the stream's words are those of EVT 3.
    pub fn new(begun: BegunDecoder, dater: Dater, as_sent: bool) -> Self {
        let BegunDecoder { decoder, first_sequence, .. } = begun;
        Self { decoder, first_sequence, begun: false, dater, anew: (!as_sent).then(Anew::default) }
    }

    /// Reads a packet, which is not written where it is not wanted.
    pub fn take(&mut self, packet: &Packet, wanted: bool) -> Result<Option<Held>, EncodeError> {
        if packet.sequence < self.first_sequence {
            return Ok(None);
        }
        hand_over(&mut self.decoder, packet, self.begun);
        self.begun = true;
        let anew = if wanted { self.anew.as_mut() } else { None };
        let mut finding = Finding { dater: &mut self.dater, anew, first_ns: None, seen: false, frames: Vec::new() };
        finding.packet(packet.sequence);
        self.decoder.decode(&packet.payload, &mut finding);
        let Finding { first_ns, seen, frames, .. } = finding;
        let words = match &mut self.anew {
            Some(anew) if wanted => Some(anew.take_words()?),
            _ => None,
        };
        Ok(wanted.then_some(Held { first_ns, seen, words, frames }))
    }

    /// What times are less than the device's, where EVT 3 cannot hold them, microseconds.
    pub fn shift_us(&self) -> u64 {
        let first_us = self.anew.as_ref().and_then(|anew| anew.first_us).unwrap_or(0);
        first_us - first_us % EVT3_ROUND_US
    }

    /// Edges that could not be encoded.
    pub fn late_edges(&self) -> u64 {
        self.anew.as_ref().map_or(0, |anew| anew.late_edges)
    }
}

/// Takes what a decoder finds in a packet.
struct Finding<'a> {
    dater: &'a mut Dater,
    anew: Option<&'a mut Anew>,
    first_ns: Option<i64>,
    seen: bool,
    frames: Vec<(ApsFrame, Option<i64>)>,
}

impl Sink for Finding<'_> {
    fn packet(&mut self, sequence: u64) {
        self.dater.packet(sequence);
    }

    fn event(&mut self, event: CdEvent) {
        if !self.seen {
            self.seen = true;
            self.first_ns = self.dater.session_ns(event.t_us);
        }
        if let Some(anew) = &mut self.anew {
            anew.events.push(event);
        }
    }

    fn edge(&mut self, edge: Edge) {
        if let Some(anew) = &mut self.anew {
            anew.edges.push(edge);
        }
    }

    fn frame(&mut self, frame: ApsFrame) {
        let mid_us = frame.exposure_start_us.midpoint(frame.exposure_end_us);
        let mid_ns = self.dater.session_ns(mid_us);
        self.frames.push((frame, mid_ns));
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.dater.discontinuity(t_us);
        if let Some(anew) = &mut self.anew {
            anew.restart();
        }
    }
}

/// Encodes the events of a stream as EVT 3, packet by packet.
#[derive(Default)]
struct Anew {
    encoder: Evt3Encoder,
    /// The first time that was encoded, microseconds.
    first_us: Option<u64>,
    /// The last time that was encoded since the last break, microseconds.
    last_us: u64,
    events: Vec<CdEvent>,
    edges: Vec<Edge>,
    words: Vec<u8>,
    late_edges: u64,
    /// Nothing was encoded since the last break.
    fresh: bool,
    error: Option<EncodeError>,
}

impl Anew {
    fn take_words(&mut self) -> Result<Vec<u8>, EncodeError> {
        self.encode();
        self.error.map_or(Ok(std::mem::take(&mut self.words)), Err)
    }

    /// Time is another from here on.
    fn restart(&mut self) {
        self.encode();
        (self.encoder, self.last_us, self.fresh) = (Evt3Encoder::default(), 0, true);
    }

    /// Encodes what was gathered, in the order of its times.
    fn encode(&mut self) {
        let (mut events, mut edges) = (std::mem::take(&mut self.events), std::mem::take(&mut self.edges));
        events.sort_by_key(|event| event.t_us);
        self.first_us = self.first_us.or(events.first().map(|event| event.t_us));
        edges.sort_by_key(|edge| edge.t_us);
        let mut edges = edges.into_iter().peekable();
        let begin = self.words.len();
        for event in events {
            while let Some(edge) = edges.next_if(|edge| edge.t_us <= event.t_us) {
                self.put_edge(edge);
            }
            let encoded = self.encoder.event(event, &mut self.words);
            self.error = self.error.or(encoded.err());
            self.last_us = event.t_us;
        }
        edges.for_each(|edge| self.put_edge(edge));
        self.encoder.finish(&mut self.words);
        if let Some(&[low, high]) = self.words.get(begin..begin + 2).filter(|_| self.fresh) {
            // A time that goes back is believed if it is told twice.
            self.words.splice(begin..begin, [low, high]);
            self.fresh = false;
        }
    }

    fn put_edge(&mut self, edge: Edge) {
        if edge.t_us < self.last_us {
            self.late_edges += 1;
            return;
        }
        let encoded = self.encoder.edge(edge, &mut self.words);
        self.error = self.error.or(encoded.err());
        self.last_us = edge.t_us;
    }
}

#[cfg(test)]
mod tests {
    use erfgs_events::{Columns, Evt3Decoder};

    use super::*;

    #[test]
    fn events_and_edges_of_a_packet_are_encoded_in_their_order_and_breaks_begin_anew() {
        let event = |t_us, x| CdEvent { t_us, x, y: 3, on: x % 2 == 0 };
        let edge = |t_us| Edge { t_us, channel: 1, rising: true };
        let mut anew = Anew::default();
        let (mut words, mut expected) = (Vec::new(), Vec::new());
        // A clock that counts since 1970, a packet out of order in itself, and a clock that begins again.
        let far = 1_700_000_000_000_000 / (1 << 24) * (1 << 24);
        for (events, edges, breaks) in [
            (vec![event(far + 20, 1), event(far + 10, 2)], vec![edge(far + 15)], false),
            (vec![event(far + 9000, 700)], vec![edge(far + 3)], false),
            (vec![event(5, 4)], vec![], true),
        ] {
            if breaks {
                anew.restart();
            }
            anew.events.clone_from(&events);
            anew.edges = edges;
            words.extend(anew.take_words().unwrap());
            let mut sorted = events;
            sorted.sort_by_key(|event| event.t_us);
            expected.extend(sorted.iter().map(|event| (event.x, event.on)));
        }
        assert_eq!(anew.late_edges, 1);
        let mut columns = Columns::default();
        let mut decoder = Evt3Decoder::new(None);
        decoder.decode(&words, &mut columns);
        decoder.finish(&mut columns);
        assert_eq!(columns.iter().map(|event| (event.x, event.on)).collect::<Vec<_>>(), expected);
        assert_eq!(columns.t_us[..3], [10, 20, 9000], "what EVT 3's clock holds of it");
        assert_eq!(columns.edges.iter().map(|edge| edge.t_us).collect::<Vec<_>>(), [15]);
        anew.events = vec![event(4, 4)];
        assert!(anew.take_words().is_err(), "time goes back without a break");
    }
}
