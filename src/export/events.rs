//! The event streams of a recording as files.

use std::{
    io::{self, Write},
    path::PathBuf,
};

use anyhow::Context;
use erfgs_base::atomic;
use erfgs_events::{
    Aedat4Compression, Aedat4Encoder, ApsFrame, CSV_HEADER, CdEvent, CsvEncoder, Edge, Event, EventBatch, Events,
    ImuSample, Mark, RawHeader, SensorSize, Sink, hdf5, npz,
};
use erfgs_session::{
    container::{ContainerError, Entry, Recording, sensor_size},
    source::Description,
};
use serde::Serialize;

use super::{Format, Task};
use crate::{
    date::utc,
    terminal::{Terminal, bytes, thousands},
};

#[derive(Serialize)]
struct Exported {
    stream: String,
    file: PathBuf,
    bytes: u64,
    /// Events in the file; absent for raw, which is not decoded.
    events: Option<u64>,
    /// Places where data of the device was lost.
    discontinuities: u64,
}

/// Writes the streams and lists them.
pub fn export(recording: &mut Recording, format: Format, tasks: &[Task], terminal: &Terminal) -> anyhow::Result<()> {
    let mut files = Vec::new();
    let lost = &mut Vec::new();
    for task in tasks {
        let total = recording.summary().streams[task.stream].totals.bytes;
        let progress = terminal.progress(&task.id);
        let mut exported = Exported {
            stream: task.id.clone(),
            file: task.out.clone(),
            bytes: 0,
            events: None,
            discontinuities: recording.summary().streams[task.stream].totals.discontinuities,
        };
        let update = |done: u64| progress.update(done, total, "bytes");
        match format {
            Format::Raw => raw(recording, task, lost, update)?,
            Format::Aedat4 => exported.events = Some(aedat4(recording, task, lost, update)?),
            Format::Csv => exported.events = Some(csv(recording, task, lost, update)?),
            Format::H5 => exported.events = Some(h5(recording, task, lost, update)?),
            _ => exported.events = Some(npz(recording, task, lost, update)?),
        }
        exported.bytes = std::fs::metadata(&task.out).map_or(0, |metadata| metadata.len());
        files.push(exported);
    }
    terminal.result(&files, || {
        let line = |file: &Exported| {
            let events = file.events.map_or(String::new(), |events| format!(", {} events", thousands(events)));
            let cuts = match file.discontinuities {
                0 => String::new(),
                count => format!("; data was lost in {count} places"),
            };
            format!("{}: {}{events}{cuts}", file.file.display(), bytes(file.bytes))
        };
        files.iter().map(line).collect::<Vec<_>>().join("\n")
    })?;
    super::complain(recording, lost)
}

/// Gives the content of a file to `fill`, whose own errors pass the file system's by.
fn write_file(task: &Task, fill: impl FnOnce(&mut dyn Write) -> Result<(), ContainerError>) -> anyhow::Result<()> {
    let mut failure = None;
    let written = atomic::write_with(&task.out, |sink| {
        fill(sink).map_err(|error| match error {
            ContainerError::Write { source, .. } => source,
            other => {
                failure = Some(other);
                io::Error::other("the recording cannot be read")
            }
        })
    });
    match failure {
        Some(error) => Err(error.into()),
        None => written.with_context(|| format!("cannot write {}", task.out.display())),
    }
}

/// An error of the file that is written; [`write_file`] names the file.
fn failed(source: io::Error) -> ContainerError {
    ContainerError::Write { path: PathBuf::new(), offset: 0, source }
}

fn raw(recording: &mut Recording, task: &Task, lost: &mut Vec<String>, progress: impl Fn(u64)) -> anyhow::Result<()> {
    let description = recording.summary().streams[task.stream].description.clone();
    let header = raw_header(&description, recording.summary().start.epoch_ns)
        .with_context(|| format!("{} has no RAW file", description.encoding))?;
    write_file(task, |sink| {
        sink.write_all(&header.encode()).map_err(failed)?;
        let mut done = 0;
        for entry in recording.messages(None) {
            match entry {
                Ok(Entry::Packet { stream, packet }) if stream == task.stream => {
                    sink.write_all(&packet.payload).map_err(failed)?;
                    done += packet.payload.len() as u64;
                    progress(done);
                }
                Ok(_) => {}
                Err(error) if is_passed_over(&error) => lost.push(error.to_string()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    })
}

/// Whether reading goes on behind the place of an error.
pub fn is_passed_over(error: &ContainerError) -> bool {
    matches!(error, ContainerError::Damaged { .. })
}

/// Decodes a stream, and tells what of it was lost to damage.
fn decode(
    recording: &mut Recording,
    task: &Task,
    sink: &mut impl Sink,
    lost: &mut Vec<String>,
    progress: impl Fn(u64),
) -> Result<(), ContainerError> {
    let decoded = recording.decode_events(task.stream, sink, progress)?;
    lost.extend(decoded.into_iter().flat_map(|decoded| decoded.damage));
    Ok(())
}

/// The header of a RAW file, from what the device said of itself.
fn raw_header(description: &Description, epoch_ns: i64) -> Option<RawHeader> {
    let size = sensor_size(description).unwrap_or(SensorSize { width: 1280, height: 720 });
    let header = RawHeader::new(description.encoding.events()?, size, &description.serial, &utc(epoch_ns))?;
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

fn csv(recording: &mut Recording, task: &Task, lost: &mut Vec<String>, progress: impl Fn(u64)) -> anyhow::Result<u64> {
    let mut events = 0;
    write_file(task, |out| {
        out.write_all(CSV_HEADER).map_err(failed)?;
        let mut sink = CsvSink { out, encoder: CsvEncoder, text: Vec::new(), events: 0, error: None };
        decode(recording, task, &mut sink, lost, progress)?;
        sink.flush();
        events = sink.events;
        sink.error.map_or(Ok(()), |error| Err(failed(error)))
    })?;
    Ok(events)
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

fn aedat4(
    recording: &mut Recording,
    task: &Task,
    lost: &mut Vec<String>,
    progress: impl Fn(u64),
) -> anyhow::Result<u64> {
    let description = recording.summary().streams[task.stream].description.clone();
    let size = sensor_size(&description).unwrap_or(SensorSize::ALL);
    let source = format!("{}_{}", description.model.replace(' ', "_"), description.serial);
    let mut events = 0;
    write_file(task, |out| {
        let encoder = Aedat4Encoder::new(size, &source, Aedat4Compression::Lz4);
        let mut sink = Aedat4Sink { out, encoder, events: 0, error: None };
        decode(recording, task, &mut sink, lost, progress)?;
        sink.flush();
        events = sink.events;
        if let Some(error) = sink.error {
            return Err(failed(error));
        }
        sink.out.write_all(&sink.encoder.finish()).map_err(failed)
    })?;
    Ok(events)
}

/// Gathers events for NumPy, in memory as its format wants.
struct Gather(Events);

impl Sink for Gather {
    fn event(&mut self, event: CdEvent) {
        let t_us = i64::try_from(event.t_us).unwrap_or(i64::MAX);
        self.0.push(Event { t_us, x: event.x, y: event.y, on: event.on });
    }
}

fn npz(recording: &mut Recording, task: &Task, lost: &mut Vec<String>, progress: impl Fn(u64)) -> anyhow::Result<u64> {
    let description = &recording.summary().streams[task.stream].description;
    let mut gather = Gather(Events::new(description.width, description.height));
    decode(recording, task, &mut gather, lost, progress)?;
    npz::write_events(&task.out, &gather.0)?;
    Ok(gather.0.len() as u64)
}

fn h5(recording: &mut Recording, task: &Task, lost: &mut Vec<String>, progress: impl Fn(u64)) -> anyhow::Result<u64> {
    let mut writer = hdf5::create(&task.out, sensor_size(&recording.summary().streams[task.stream].description))?;
    decode(recording, task, &mut writer, lost, progress)?;
    Ok(writer.finish()?)
}
