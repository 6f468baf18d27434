//! The events of a stream as a file.

use std::{
    io::{self, Write},
    path::Path,
};

use erfgs_base::{atomic, calendar::DateTime};
use erfgs_events::{
    Aedat4Compression, Aedat4Encoder, ApsFrame, CSV_HEADER, CdEvent, CsvEncoder, Edge, Event, EventBatch, Events,
    ImuSample, Mark, RawHeader, SensorSize, Sink, hdf5, npz,
};

use super::{ExportError, anew, is_passed_over};
use crate::{
    container::{Entry, Recording, sensor_size},
    source::{Description, Encoding},
};

/// What events are written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventsFormat {
    /// The words of a Prophesee sensor as they came, with the header that Metavision looks for. Events that have none are
    /// encoded: as EVT 3, or EVT 2 where their times need it.
    Raw,
    /// DAT, version 2.
    Dat,
    /// Events, edges, frames and inertial samples, as DV reads them.
    Aedat4,
    /// Lines of t, x, y, on.
    Csv,
    /// NumPy's arrays t, x, y, p.
    Npz,
    /// HDF5 in the layout of the DSEC data set.
    Hdf5,
}

impl EventsFormat {
    /// Whether a stream of this encoding can be written so: all take the events of all streams.
    #[must_use]
    pub fn fits(self, encoding: Encoding) -> bool {
        encoding.is_events()
    }
}

/// What was written of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WrittenEvents {
    /// How many events there are; of RAW that is not decoded, nobody counts them.
    pub events: Option<u64>,
    /// What was taken off the times, microseconds: they begin later than the format's clock goes, as those since 1970 do.
    pub shift_us: u64,
}

/// Writes the events of the stream `id` to `path`, which appears whole or not at all (what was there is replaced). What was lost to damage of the recording is added
/// to `damage`; `progress` is called with the bytes of payload so far.
///
/// # Errors
/// If the recording has no such stream or cannot be read, if the stream does not fit the format, or if the file cannot be
/// written.
pub fn write_events(
    recording: &mut Recording,
    id: &str,
    format: EventsFormat,
    path: &Path,
    damage: &mut Vec<String>,
    progress: impl FnMut(u64),
) -> Result<WrittenEvents, ExportError> {
    let (stream, recorded) = recording.stream(id)?;
    let description = recorded.description.clone();
    let mut task = Task { recording, stream, description, path, damage };
    match format {
        EventsFormat::Raw => task.raw(progress),
        EventsFormat::Dat => anew(&mut task, true, progress),
        EventsFormat::Aedat4 => task.aedat4(progress).map(counted),
        EventsFormat::Csv => task.csv(progress).map(counted),
        EventsFormat::Npz => task.npz(progress).map(counted),
        EventsFormat::Hdf5 => task.hdf5(progress).map(counted),
    }
}

fn counted(events: u64) -> WrittenEvents {
    WrittenEvents { events: Some(events), shift_us: 0 }
}

fn anew(task: &mut Task<'_>, as_dat: bool, progress: impl FnMut(u64)) -> Result<WrittenEvents, ExportError> {
    let (events, shift_us) = anew::write(task, as_dat, progress)?;
    Ok(WrittenEvents { events: Some(events), shift_us })
}

/// A stream and where it goes.
pub(super) struct Task<'a> {
    pub recording: &'a mut Recording,
    stream: usize,
    pub description: Description,
    pub path: &'a Path,
    pub damage: &'a mut Vec<String>,
}

impl Task<'_> {
    fn no_events(&self) -> ExportError {
        ExportError::NoEvents { id: self.description.id.clone() }
    }

    /// Decodes the stream, and tells what of it was lost to damage.
    pub fn decode(&mut self, sink: &mut impl Sink, progress: impl FnMut(u64)) -> Result<(), ExportError> {
        let decoded = self.recording.decode_events(self.stream, sink, progress)?;
        let decoded = decoded.ok_or_else(|| self.no_events())?;
        self.damage.extend(decoded.damage);
        Ok(())
    }

    fn raw(&mut self, mut progress: impl FnMut(u64)) -> Result<WrittenEvents, ExportError> {
        let Some(header) = raw_header(&self.description, self.recording.summary().start.epoch_ns) else {
            return anew(self, false, progress);
        };
        let path = self.path;
        let failed = ExportError::writing(path);
        let fill = |sink: &mut io::BufWriter<&std::fs::File>| {
            sink.write_all(&header.encode()).map_err(&failed)?;
            let (mut done, mut packets) = (0, 0);
            for entry in self.recording.messages(None) {
                match entry {
                    Ok(Entry::Packet { stream, packet }) if stream == self.stream => {
                        sink.write_all(&packet.payload).map_err(&failed)?;
                        done += packet.payload.len() as u64;
                        packets += 1;
                        progress(done);
                    }
                    Ok(_) => {}
                    Err(error) if is_passed_over(&error) => self.damage.push(error.to_string()),
                    Err(error) => return Err(error.into()),
                }
            }
            self.damage.extend(self.recording.lacking(self.stream, packets));
            Ok(WrittenEvents::default())
        };
        atomic::try_write_with(path, fill, &failed)
    }

    fn csv(&mut self, progress: impl FnMut(u64)) -> Result<u64, ExportError> {
        let path = self.path;
        let failed = ExportError::writing(path);
        let fill = |out: &mut io::BufWriter<&std::fs::File>| {
            out.write_all(CSV_HEADER).map_err(&failed)?;
            let mut sink = CsvSink { out, encoder: CsvEncoder, text: Vec::new(), events: 0, error: None };
            self.decode(&mut sink, progress)?;
            sink.flush();
            sink.error.map_or(Ok(sink.events), |error| Err(failed(error)))
        };
        atomic::try_write_with(path, fill, &failed)
    }

    fn aedat4(&mut self, progress: impl FnMut(u64)) -> Result<u64, ExportError> {
        let size = sensor_size(&self.description).unwrap_or(SensorSize::ALL);
        let source = format!("{}_{}", self.description.model.replace(' ', "_"), self.description.serial);
        let path = self.path;
        let failed = ExportError::writing(path);
        let fill = |out: &mut io::BufWriter<&std::fs::File>| {
            let encoder = Aedat4Encoder::new(size, &source, Aedat4Compression::Lz4);
            let mut sink = Aedat4Sink { out, encoder, events: 0, error: None };
            self.decode(&mut sink, progress)?;
            sink.flush();
            if let Some(error) = sink.error {
                return Err(failed(error));
            }
            sink.out.write_all(&sink.encoder.finish()).map_err(&failed)?;
            Ok(sink.events)
        };
        atomic::try_write_with(path, fill, &failed)
    }

    fn npz(&mut self, progress: impl FnMut(u64)) -> Result<u64, ExportError> {
        let mut gather = Gather(Events::new(self.description.width, self.description.height));
        self.decode(&mut gather, progress)?;
        npz::write_events(self.path, &gather.0)?;
        Ok(gather.0.len() as u64)
    }

    fn hdf5(&mut self, progress: impl FnMut(u64)) -> Result<u64, ExportError> {
        let mut writer = hdf5::create(self.path, sensor_size(&self.description))?;
        self.decode(&mut writer, progress)?;
        Ok(writer.finish()?)
    }
}

/// The header of a RAW file, from what the device said of itself.
fn raw_header(description: &Description, epoch_ns: i64) -> Option<RawHeader> {
    let size = sensor_size(description).unwrap_or(SensorSize { width: 1280, height: 720 });
    let date = DateTime::of_ns(epoch_ns).to_string();
    let header = RawHeader::new(description.encoding.events()?, size, &description.serial, &date)?;
    let firmware = description.settings.get("firmware").and_then(serde_json::Value::as_str).unwrap_or("");
    let is_imx636 = description.model.contains("EVK4") || description.model.contains("IMX636");
    Some(if is_imx636 { header.with_imx636(firmware) } else { header })
}

/// Writes events as they are decoded; the first error ends the writing.
struct CsvSink<'a> {
    out: &'a mut dyn Write,
    encoder: CsvEncoder,
    text: Vec<u8>,
    events: u64,
    error: Option<io::Error>,
}

impl Sink for CsvSink<'_> {
    fn event(&mut self, event: CdEvent) {
        self.events += 1;
        self.encoder.event(event, &mut self.text);
        if self.text.len() > 1 << 16 {
            self.flush();
        }
    }
}

impl CsvSink<'_> {
    fn flush(&mut self) {
        if self.error.is_none() {
            self.error = self.out.write_all(&self.text).err();
        }
        self.text.clear();
    }
}

/// Writes AEDAT 4 as it is encoded; the first error ends the writing.
struct Aedat4Sink<'a> {
    out: &'a mut dyn Write,
    encoder: Aedat4Encoder,
    events: u64,
    error: Option<io::Error>,
}

impl Aedat4Sink<'_> {
    fn flush(&mut self) {
        let bytes = self.encoder.take();
        if self.error.is_none() {
            self.error = self.out.write_all(&bytes).err();
        }
    }
}

impl Sink for Aedat4Sink<'_> {
    fn event(&mut self, event: CdEvent) {
        self.events += 1;
        self.encoder.event(event);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.events += batch.t_us.len() as u64;
        self.encoder.events(batch);
        self.flush();
    }

    fn mark(&mut self, t_us: u64, mark: Mark) {
        self.encoder.mark(t_us, mark);
    }

    fn edge(&mut self, edge: Edge) {
        self.encoder.edge(edge);
    }

    fn imu(&mut self, sample: ImuSample) {
        self.encoder.imu(sample);
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.encoder.frame(frame);
        self.flush();
    }
}

/// Gathers events for NumPy, in memory as its format wants.
struct Gather(Events);

impl Sink for Gather {
    fn event(&mut self, event: CdEvent) {
        let t_us = i64::try_from(event.t_us).unwrap_or(i64::MAX);
        self.0.push(Event { t_us, x: event.x, y: event.y, on: event.on });
    }
}
