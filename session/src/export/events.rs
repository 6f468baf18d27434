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

use super::{ExportError, is_passed_over};
use crate::{
    container::{Entry, Recording, sensor_size},
    source::{Description, Encoding},
};

/// What events are written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventsFormat {
    /// The words of a Prophesee sensor as they came, with the header that Metavision looks for.
    Raw,
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
    /// Whether a stream of this encoding can be written so.
    #[must_use]
    pub fn fits(self, encoding: Encoding) -> bool {
        match self {
            Self::Raw => {
                encoding.events().is_some_and(|events| RawHeader::new(events, SensorSize::ALL, "", "").is_some())
            }
            _ => encoding.is_events(),
        }
    }
}

/// Writes the events of the stream `id` to `path`, which appears whole or not at all (what was there is replaced), and says
/// how many there are; of RAW, which is not decoded, nobody counts them. What was lost to damage of the recording is added
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
) -> Result<Option<u64>, ExportError> {
    let (stream, recorded) = recording.stream(id)?;
    let description = recorded.description.clone();
    let mut task = Task { recording, stream, description, path, damage };
    match format {
        EventsFormat::Raw => task.raw(progress).map(|()| None),
        EventsFormat::Aedat4 => task.aedat4(progress).map(Some),
        EventsFormat::Csv => task.csv(progress).map(Some),
        EventsFormat::Npz => task.npz(progress).map(Some),
        EventsFormat::Hdf5 => task.hdf5(progress).map(Some),
    }
}

/// A stream and where it goes.
struct Task<'a> {
    recording: &'a mut Recording,
    stream: usize,
    description: Description,
    path: &'a Path,
    damage: &'a mut Vec<String>,
}

impl Task<'_> {
    fn no_events(&self) -> ExportError {
        ExportError::NoEvents { id: self.description.id.clone() }
    }

    /// Decodes the stream, and tells what of it was lost to damage.
    fn decode(&mut self, sink: &mut impl Sink, progress: impl FnMut(u64)) -> Result<(), ExportError> {
        let decoded = self.recording.decode_events(self.stream, sink, progress)?;
        let decoded = decoded.ok_or_else(|| self.no_events())?;
        self.damage.extend(decoded.damage);
        Ok(())
    }

    fn raw(&mut self, mut progress: impl FnMut(u64)) -> Result<(), ExportError> {
        let header = raw_header(&self.description, self.recording.summary().start.epoch_ns).ok_or_else(|| {
            let encoding = self.description.encoding.events();
            encoding.map_or_else(|| self.no_events(), |encoding| ExportError::NoRaw { encoding })
        })?;
        let path = self.path;
        let failed = ExportError::writing(path);
        let fill = |sink: &mut io::BufWriter<&std::fs::File>| {
            sink.write_all(&header.encode()).map_err(&failed)?;
            let mut done = 0;
            for entry in self.recording.messages(None) {
                match entry {
                    Ok(Entry::Packet { stream, packet }) if stream == self.stream => {
                        sink.write_all(&packet.payload).map_err(&failed)?;
                        done += packet.payload.len() as u64;
                        progress(done);
                    }
                    Ok(_) => {}
                    Err(error) if is_passed_over(&error) => self.damage.push(error.to_string()),
                    Err(error) => return Err(error.into()),
                }
            }
            Ok(())
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
