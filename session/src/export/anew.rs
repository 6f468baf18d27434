//! The events of streams that have no words of a Prophesee sensor, encoded as RAW and DAT.

use std::{io::Write, iter::Peekable, path::Path, vec};

use erfgs_base::{atomic, calendar::DateTime};
use erfgs_events::{
    CdEvent, DatEncoder, DatFormat, Edge, EncodeError, EventBatch, EventEncoding, Evt2Encoder, Evt3Encoder, RawHeader,
    SensorSize, Sink,
};

use super::{ExportError, events::Task};

/// Times from here on are lost in EVT 3, whose readers count the rounds of its clock from the first event on.
const EVT3_LOOP_US: u64 = 1 << 24;
/// Likewise in EVT 2, and in what else has 34 bits of time.
const EVT2_LOOP_US: u64 = 1 << 34;
/// Bytes that are gathered before they are written.
const PIECE: usize = 1 << 16;

enum Encoder {
    Evt2(Evt2Encoder),
    Evt3(Evt3Encoder),
    Dat(DatEncoder),
}

/// Encodes events as they are decoded, with the edges of their time between them; the first error ends it.
struct AnewSink<'a> {
    out: &'a mut dyn Write,
    encoder: Encoder,
    /// What is taken off the times.
    shift_us: u64,
    edges: Peekable<vec::IntoIter<Edge>>,
    bytes: Vec<u8>,
    events: u64,
    encode_error: Option<EncodeError>,
    write_error: Option<std::io::Error>,
}

impl AnewSink<'_> {
    fn is_over(&self) -> bool {
        self.encode_error.is_some() || self.write_error.is_some()
    }

    fn take(&mut self, encoded: Result<(), EncodeError>) {
        self.encode_error = self.encode_error.or(encoded.err());
        if self.bytes.len() >= PIECE {
            self.flush();
        }
    }

    fn put_edge(&mut self, edge: Edge) {
        let edge = Edge { t_us: edge.t_us.saturating_sub(self.shift_us), ..edge };
        let encoded = match &mut self.encoder {
            Encoder::Evt2(encoder) => encoder.edge(edge, &mut self.bytes),
            Encoder::Evt3(encoder) => encoder.edge(edge, &mut self.bytes),
            Encoder::Dat(_) => Ok(()),
        };
        self.take(encoded);
    }

    fn finish(&mut self) {
        while let Some(edge) = self.edges.next() {
            self.put_edge(edge);
        }
        if let Encoder::Evt3(encoder) = &mut self.encoder {
            encoder.finish(&mut self.bytes);
        }
        self.flush();
    }

    fn flush(&mut self) {
        if self.write_error.is_none() {
            self.write_error = self.out.write_all(&self.bytes).err();
        }
        self.bytes.clear();
    }
}

impl Sink for AnewSink<'_> {
    fn event(&mut self, event: CdEvent) {
        if self.is_over() {
            return;
        }
        while let Some(edge) = self.edges.next_if(|edge| edge.t_us <= event.t_us) {
            self.put_edge(edge);
        }
        self.events += 1;
        let event = CdEvent { t_us: event.t_us.saturating_sub(self.shift_us), ..event };
        let encoded = match &mut self.encoder {
            Encoder::Evt2(encoder) => encoder.event(event, &mut self.bytes),
            Encoder::Evt3(encoder) => encoder.event(event, &mut self.bytes),
            Encoder::Dat(encoder) => encoder.event(event, &mut self.bytes),
        };
        self.take(encoded);
    }
}

/// The first time, and all edges.
#[derive(Default)]
struct Before {
    first_us: Option<u64>,
    edges: Vec<Edge>,
}

impl Sink for Before {
    fn event(&mut self, event: CdEvent) {
        self.first_us = Some(self.first_us.map_or(event.t_us, |first| first.min(event.t_us)));
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        let first = batch.t_us.iter().copied().min();
        self.first_us = self.first_us.into_iter().chain(first).min();
    }

    fn edge(&mut self, edge: Edge) {
        self.first_us = Some(self.first_us.map_or(edge.t_us, |first| first.min(edge.t_us)));
        self.edges.push(edge);
    }
}

/// Decodes a stream and encodes its events anew; gives their number, and what was taken off their times, which is more than
/// nothing only where the format could not hold them.
pub(super) fn write(task: &mut Task<'_>, as_dat: bool, progress: impl FnMut(u64)) -> Result<(u64, u64), ExportError> {
    let mut before = Before::default();
    let lost = task.damage.len();
    task.decode(&mut before, |_| {})?;
    // It is decoded once more, and tells the same again.
    task.damage.truncate(lost);
    before.edges.sort_by_key(|edge| edge.t_us);
    let first_us = before.first_us.unwrap_or(0);
    let size = crate::container::sensor_size(&task.description).unwrap_or(SensorSize { width: 1280, height: 720 });
    let date = DateTime::of_ns(task.recording.summary().start.epoch_ns).to_string();
    let (encoding, loop_us) =
        if first_us < EVT3_LOOP_US { (EventEncoding::Evt3, EVT3_LOOP_US) } else { (EventEncoding::Evt2, EVT2_LOOP_US) };
    // DAT has 32 bits of time, and its readers count rounds as well.
    let loop_us = if as_dat { 1 << 32 } else { loop_us };
    let shift_us = if first_us < loop_us { 0 } else { first_us };
    let (encoding, encoder) = match encoding {
        _ if as_dat => (encoding, Encoder::Dat(DatEncoder::default())),
        _ if shift_us > 0 || encoding == EventEncoding::Evt3 => {
            (EventEncoding::Evt3, Encoder::Evt3(Evt3Encoder::default()))
        }
        _ => (encoding, Encoder::Evt2(Evt2Encoder::default())),
    };
    let header = match as_dat {
        true => DatFormat::header(size, &date),
        false => RawHeader::new(encoding, size, &task.description.serial, &date)
            .map(|header| header.encode())
            .unwrap_or_default(),
    };
    let path: &Path = task.path;
    let failed = ExportError::writing(path);
    let fill = |out: &mut std::io::BufWriter<&std::fs::File>| {
        out.write_all(&header).map_err(&failed)?;
        let edges = std::mem::take(&mut before.edges).into_iter().peekable();
        let (encode_error, write_error) = (None, None);
        let mut sink =
            AnewSink { out, encoder, shift_us, edges, bytes: Vec::new(), events: 0, encode_error, write_error };
        task.decode(&mut sink, progress)?;
        sink.finish();
        match (sink.encode_error, sink.write_error) {
            (Some(source), _) => Err(ExportError::Unfit { path: path.to_owned(), source }),
            (_, Some(error)) => Err(failed(error)),
            _ => Ok(sink.events),
        }
    };
    Ok((atomic::try_write_with(path, fill, &failed)?, shift_us))
}
