//! The items of a file, encoded into packets.

use std::cell::Cell;

use super::{
    host_clock::HostClock,
    packets::{Out, PACKET_BYTES, PACKET_NS},
    source::EventSource,
};
use crate::container::ContainerError;
use erfgs_events::EventEncoding;
use erfgs_events::{Aedat4Encoder, ApsFrame, CdEvent, Edge, EncodeError, Evt2Encoder, ImuSample, Mark, Sink};

/// Bytes of an event, a sample or a mark of AEDAT 4 before compression, about.
const ITEM_BYTES: usize = 16;

/// The last time at which a stream of EVT 2 can begin: rounds of its clock before the first event are lost.
const EVT2_LAST_US: u64 = (1 << 34) - 1;

enum Encoder {
    Evt2(Evt2Encoder, Vec<u8>),
    Aedat4(Aedat4Encoder),
}

/// Encodes what comes; the first error ends it.
struct Packer<'a> {
    encoder: Encoder,
    clock: HostClock,
    /// Host time of the packet's first item.
    begun_ns: Option<i64>,
    /// Bytes of the packet so far, about.
    bytes: usize,
    out: &'a mut Out,
    error: Option<EncodeError>,
    /// Whether nothing more is wanted.
    over: &'a Cell<bool>,
}

/// Encodes the file into packets.
pub(super) fn pack(
    source: &EventSource,
    encoding: EventEncoding,
    first_us: u64,
    out: &mut Out,
) -> Result<(), ContainerError> {
    if encoding == EventEncoding::Evt2 && first_us > EVT2_LAST_US {
        return Err(ContainerError::event_file(source.path(), Unfit::Late { first_us }));
    }
    // The edges of HDF5 lie behind all events, and words of EVT go by time.
    let mut edges = Vec::new();
    if matches!(source, EventSource::Hdf5 { .. }) && encoding == EventEncoding::Evt2 {
        let mut gather = Edges(Vec::new());
        source.decode(&mut gather, |_| true)?;
        edges = gather.0;
        edges.sort_by_key(|edge| edge.t_us);
    }
    let encoder = match encoding {
        EventEncoding::Aedat4 => Encoder::Aedat4(Aedat4Encoder::packets()),
        _ => Encoder::Evt2(Evt2Encoder::default(), Vec::new()),
    };
    let clock = HostClock::new(first_us);
    let over = Cell::new(false);
    let mut packer = Packer { encoder, clock, begun_ns: None, bytes: 0, out, error: None, over: &over };
    if edges.is_empty() {
        source.decode(&mut packer, |_| !over.get())?;
    } else {
        let mut merged = Merged { packer: &mut packer, edges: edges.into_iter().peekable() };
        source.decode(&mut merged, |_| true)?;
        let Merged { packer, edges } = merged;
        edges.for_each(|edge| packer.edge(edge));
    }
    packer.close();
    match packer.error {
        Some(error) => Err(ContainerError::event_file(source.path(), Unfit::Item(error))),
        None => Ok(()),
    }
}

/// What the packets of a file's format cannot hold.
#[derive(Debug, thiserror::Error)]
enum Unfit {
    #[error("cannot be played or imported: {0}")]
    Item(EncodeError),
    #[error(
        "cannot be played or imported: it begins at {first_us} µs, and EVT 2 holds times from 0 to 4 h 46 min; take a \
         constant off its times, or convert it to CSV or NPZ"
    )]
    Late { first_us: u64 },
}

impl Packer<'_> {
    /// Begins a new packet if this one is over before an item of device time `t_us`.
    fn at(&mut self, t_us: u64, bytes: usize) {
        let mut after = self.clock;
        let now_ns = after.host_ns(t_us);
        let over = self.begun_ns.is_some_and(|begun_ns| now_ns.saturating_sub(begun_ns) >= PACKET_NS);
        if over || self.bytes >= PACKET_BYTES {
            self.close();
        }
        self.clock = after;
        self.begun_ns.get_or_insert(now_ns);
        self.bytes += bytes;
    }

    fn close(&mut self) {
        let payload = match &mut self.encoder {
            Encoder::Evt2(_, bytes) => std::mem::take(bytes),
            Encoder::Aedat4(encoder) => {
                encoder.flush();
                encoder.take()
            }
        };
        if !payload.is_empty() {
            self.out.send(self.clock.last_ns(), payload);
            self.over.set(!self.out.is_wanted());
        }
        (self.begun_ns, self.bytes) = (None, 0);
    }

    fn refused(&mut self, encoded: Result<(), EncodeError>) {
        if let Err(error) = encoded {
            self.error = Some(error);
            self.over.set(true);
        }
    }
}

impl Sink for Packer<'_> {
    fn event(&mut self, event: CdEvent) {
        if self.over.get() {
            return;
        }
        self.at(event.t_us, ITEM_BYTES);
        let encoded = match &mut self.encoder {
            Encoder::Evt2(encoder, bytes) => encoder.event(event, bytes),
            Encoder::Aedat4(encoder) => {
                encoder.event(event);
                Ok(())
            }
        };
        self.refused(encoded);
    }

    fn edge(&mut self, edge: Edge) {
        if self.over.get() {
            return;
        }
        self.at(edge.t_us, ITEM_BYTES);
        let encoded = match &mut self.encoder {
            Encoder::Evt2(encoder, bytes) => encoder.edge(edge, bytes),
            Encoder::Aedat4(encoder) => {
                encoder.edge(edge);
                Ok(())
            }
        };
        self.refused(encoded);
    }

    fn mark(&mut self, t_us: u64, mark: Mark) {
        match &mut self.encoder {
            Encoder::Evt2(..) => {
                if let Some(edge) = mark.edge(t_us) {
                    self.edge(edge);
                }
            }
            Encoder::Aedat4(_) => {
                self.at(t_us, ITEM_BYTES);
                if let Encoder::Aedat4(encoder) = &mut self.encoder {
                    encoder.mark(t_us, mark);
                }
            }
        }
    }

    fn imu(&mut self, sample: ImuSample) {
        self.at(sample.t_us, ITEM_BYTES);
        if let Encoder::Aedat4(encoder) = &mut self.encoder {
            encoder.imu(sample);
        }
    }

    fn frame(&mut self, frame: ApsFrame) {
        // A frame is there once it is exposed.
        self.at(frame.exposure_end_us, frame.pixels.len());
        if let Encoder::Aedat4(encoder) = &mut self.encoder {
            encoder.frame(frame);
        }
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.clock.discontinuity(t_us);
    }
}

/// Takes edges alone.
struct Edges(Vec<Edge>);

impl Sink for Edges {
    fn event(&mut self, _event: CdEvent) {}

    fn events(&mut self, _batch: erfgs_events::EventBatch<'_>) {}

    fn edge(&mut self, edge: Edge) {
        self.0.push(edge);
    }
}

/// Puts edges between events.
struct Merged<'a, 'b> {
    packer: &'a mut Packer<'b>,
    edges: std::iter::Peekable<std::vec::IntoIter<Edge>>,
}

impl Sink for Merged<'_, '_> {
    fn event(&mut self, event: CdEvent) {
        while let Some(edge) = self.edges.next_if(|edge| edge.t_us <= event.t_us) {
            self.packer.edge(edge);
        }
        self.packer.event(event);
    }
}

#[cfg(test)]
mod tests {
    use super::super::packets::Packets;
    use super::*;
    use erfgs_events::EventFileHints;

    #[test]
    fn a_beginning_that_evt2_would_lose_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("e.csv");
        std::fs::write(&path, "t,x,y,on\n20000000000,1,2,1\n").unwrap();
        let source = EventSource::open(&path, &EventFileHints::default()).unwrap();
        let first = |encoding| Packets::start(source.clone(), encoding, 20_000_000_000).next().unwrap();
        let message = first(EventEncoding::Evt2).unwrap_err().to_string();
        assert!(
            message.contains("e.csv") && message.contains("20000000000") && message.contains("4 h 46 min"),
            "{message}"
        );
        assert_eq!(first(EventEncoding::Aedat4).unwrap().host_ns, 0);
    }
}
