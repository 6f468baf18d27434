//! The events of a stream of a session, decoded.

use std::io::{Read, Seek};

use super::Session;
use crate::{
    container::{BegunDecoder, ContainerError, DecodedStream, DecoderState, Entry},
    source::{Description, LATE_NS, Packet},
};
use erfgs_events::{Decoder, EventEncoding, SensorSize, Sink, StreamDecoder};

/// States lie about a second apart: one is looked for in so much time before the start.
const STATE_SEARCH_NS: i64 = 3_000_000_000;

/// The sensor's size, if the description has one that a sensor can have.
#[must_use]
pub fn sensor_size(description: &Description) -> Option<SensorSize> {
    let width = u16::try_from(description.width).ok().filter(|&width| width > 0)?;
    let height = u16::try_from(description.height).ok().filter(|&height| height > 0)?;
    Some(SensorSize { width, height })
}

impl<R: Read + Seek> Session<R> {
    /// Decodes the events of a stream into `sink`: all of them, or those of packets that arrived within `window_host_ns`.
    /// Then decoding starts at the last decoder state before (or at the beginning, where none was recorded or the stream has
    /// breaks), and what is older is not handed on. `progress` is called with the bytes of payload decoded so far. `None` if
    /// the stream has no events, or events that erfgs does not decode.
    ///
    /// # Errors
    /// If the session cannot be read.
    pub fn decode_events(
        &mut self,
        stream: usize,
        window_host_ns: Option<[i64; 2]>,
        sink: &mut impl Sink,
        mut progress: impl FnMut(u64),
    ) -> Result<Option<DecodedStream>, ContainerError> {
        let Some(recorded) = self.summary().streams.get(stream) else { return Ok(None) };
        let (id, expected) = (recorded.description.id.clone(), recorded.totals.packets);
        let window_host_ns = window_host_ns.or(self.window());
        let [from, to] = window_host_ns.unwrap_or([i64::MIN, i64::MAX]);
        let Some(begun) = self.decoder_from(stream, window_host_ns.map(|[from, _]| from))? else { return Ok(None) };
        let BegunDecoder { mut decoder, first_sequence, host_ns } = begun;
        let mut decoded = DecodedStream::default();
        for entry in self.messages_within(host_ns, i64::MAX) {
            let packet = match entry {
                Ok(Entry::Packet { packet, .. }) if packet.host_ns > to.saturating_add(LATE_NS) => break,
                Ok(Entry::Packet { stream: of, packet }) if of == stream && packet.host_ns <= to => packet,
                Ok(_) => continue,
                Err(error @ ContainerError::Read { .. }) => return Err(error),
                Err(error) => {
                    decoded.damage.push(error.to_string());
                    continue;
                }
            };
            if packet.sequence < first_sequence {
                continue;
            }
            hand_over(&mut decoder, &packet, decoded.packets > 0);
            if packet.host_ns >= from {
                sink.packet(packet.sequence);
                decoder.decode(&packet.payload, sink);
            } else {
                decoder.decode(&packet.payload, &mut Nowhere);
            }
            decoded.packets += 1;
            decoded.bytes += packet.payload.len() as u64;
            progress(decoded.bytes);
        }
        decoder.finish(sink);
        decoded.anomalies = decoder.anomalies();
        if window_host_ns.is_none() {
            decoded.damage.extend(lacking(&id, decoded.packets, expected));
        }
        Ok(Some(decoded))
    }

    /// A decoder of a stream of events that knows at host time `from_host_ns` what one knows that began at the beginning: it begins at
    /// the last state that was recorded before, or at the beginning, where none was recorded or the stream has breaks. `None` if the
    /// stream has no events, or events that erfgs does not decode.
    ///
    /// # Errors
    /// If the session cannot be read.
    pub fn decoder_from(
        &mut self,
        stream: usize,
        from_host_ns: Option<i64>,
    ) -> Result<Option<BegunDecoder>, ContainerError> {
        let Some(recorded) = self.summary().streams.get(stream) else { return Ok(None) };
        let (id, breaks) = (recorded.description.id.clone(), recorded.totals.discontinuities);
        let (encoding, size) = (recorded.description.encoding.events(), sensor_size(&recorded.description));
        let Some(encoding) = encoding else { return Ok(None) };
        // Across a break, decoders that began at different places may count the roll-overs of a clock differently, and the
        // epochs of a stream are those of one that began at its beginning.
        let state = match from_host_ns {
            Some(from) if breaks == 0 => self.state_before(&id, from)?,
            _ => None,
        };
        // A part that is read by itself begins with the state behind those before.
        let state = match state {
            None if self.summary().part.as_ref().is_some_and(|part| part.number > 0) => {
                self.first_state(stream, &id)?
            }
            state => state,
        };
        // Packets of AEDAT 4 remember nothing of each other.
        let anywhere = from_host_ns.filter(|_| encoding == EventEncoding::Aedat4);
        Ok(match state {
            Some(state) => StreamDecoder::from_state(encoding, state.state, size).map(|decoder| BegunDecoder {
                decoder,
                first_sequence: state.sequence,
                host_ns: Some(state.host_ns),
            }),
            None => {
                let decoder = StreamDecoder::new(encoding, size);
                Some(BegunDecoder { decoder, first_sequence: 0, host_ns: anywhere })
            }
        })
    }

    /// The state of a stream's decoder before its first packet, if there is one.
    fn first_state(&mut self, stream: usize, id: &str) -> Result<Option<DecoderState>, ContainerError> {
        for entry in self.messages_within(None, i64::MAX) {
            match entry {
                Ok(Entry::DecoderState(state)) if state.stream == id => return Ok(Some(state)),
                Ok(Entry::Packet { stream: of, .. }) if of == stream => break,
                Err(error @ ContainerError::Read { .. }) => return Err(error),
                _ => {}
            }
        }
        Ok(None)
    }

    /// The last state of a stream's decoder at or before a host time.
    fn state_before(&mut self, id: &str, host_ns: i64) -> Result<Option<DecoderState>, ContainerError> {
        let mut found = None;
        for entry in self.messages_within(Some(host_ns.saturating_sub(STATE_SEARCH_NS)), i64::MAX) {
            match entry {
                Ok(Entry::DecoderState(state)) if state.stream == id && state.host_ns <= host_ns => found = Some(state),
                Ok(Entry::Packet { packet, .. }) if packet.host_ns > host_ns.saturating_add(LATE_NS) => break,
                Err(error @ ContainerError::Read { .. }) => return Err(error),
                _ => {}
            }
        }
        Ok(found)
    }
}

/// What to say of a stream that has fewer packets than were recorded.
pub(crate) fn lacking(id: &str, found: u64, expected: u64) -> Option<String> {
    (found < expected).then(|| format!("stream '{id}' has {found} packets of the {expected} that were recorded"))
}

/// Tells a decoder what is known of a packet before its bytes. Where data was lost before any came, nothing was cut.
pub fn hand_over(decoder: &mut impl Decoder, packet: &Packet, begun: bool) {
    if packet.discontinuity && begun {
        decoder.restart();
    }
    decoder.hint_host_us(u64::try_from(packet.host_ns / 1000).unwrap_or(0));
}

/// A sink for what nobody wants.
pub(in crate::container) struct Nowhere;

impl Sink for Nowhere {
    fn event(&mut self, _event: erfgs_events::CdEvent) {}

    fn events(&mut self, _batch: erfgs_events::EventBatch<'_>) {}
}
