//! Session files: the recorder's sink into the MCAP container.

use std::{
    collections::BTreeMap,
    fs::File,
    io::Write,
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

use erfgs_session::{
    container::{self, ContainerError, SessionStart, SessionWriter, Settings, StreamId},
    source::{Description, Incident, Packet},
};

use crate::host_time::host_ns;

use super::{
    sink::{OpenSession, SessionInfo, SessionSink, SinkError},
    status::Status,
};

/// Opens session files.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mcap {
    /// How they are written.
    pub settings: Settings,
}

impl Mcap {
    /// A session into any writer; `path` names it in errors.
    ///
    /// # Errors
    /// If the writer fails.
    pub fn write_to<W: Write + Send + 'static>(
        self,
        writer: W,
        path: &Path,
        info: &SessionInfo,
        streams: &[Description],
    ) -> Result<Box<dyn SessionSink>, SinkError> {
        let failed = |error| sort(path, error);
        let epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let start = SessionStart {
            host_ns: host_ns(),
            epoch_ns: i64::try_from(epoch.as_nanos()).unwrap_or(i64::MAX),
            program: info.program.clone(),
            machine: info.machine.clone(),
        };
        let begin = start.host_ns;
        let mut writer = SessionWriter::new(writer, path, start, &info.configuration, self.settings).map_err(failed)?;
        let ids: Result<Vec<StreamId>, _> = streams.iter().map(|stream| writer.add_stream(stream)).collect();
        let ids = ids.map_err(failed)?;
        for message in &info.warnings {
            let warning = Incident::Warning { message: message.clone() };
            writer.incident(None, begin, &warning).map_err(failed)?;
        }
        // The streams are in the file before anything can go wrong.
        writer.flush().map_err(failed)?;
        Ok(Box::new(McapSink { path: path.to_path_buf(), writer, ids }))
    }
}

impl OpenSession for Mcap {
    fn open(
        &self,
        path: &Path,
        info: &SessionInfo,
        streams: &[Description],
    ) -> Result<Box<dyn SessionSink>, SinkError> {
        let file = File::create_new(path).map_err(|error| SinkError::io(path, error))?;
        self.write_to(file, path, info, streams)
    }
}

struct McapSink<W: Write> {
    path: PathBuf,
    writer: SessionWriter<W>,
    ids: Vec<StreamId>,
}

impl<W: Write + Send> SessionSink for McapSink<W> {
    fn packet(&mut self, stream: usize, packet: &Packet) -> Result<(), SinkError> {
        self.writer.packet(self.ids[stream], packet).map_err(|error| sort(&self.path, error))
    }

    fn incident(&mut self, stream: Option<usize>, host_ns: i64, incident: &Incident) -> Result<(), SinkError> {
        let stream = stream.map(|stream| self.ids[stream]);
        self.writer.incident(stream, host_ns, incident).map_err(|error| sort(&self.path, error))
    }

    fn status(&mut self, status: &Status) -> Result<(), SinkError> {
        let streams = status.streams.iter().map(|stream| {
            let drops = stream.drops;
            let dropped = [("queue", drops.queue), ("writer", drops.writer)];
            let entry = container::StreamStatus {
                counters: stream.counters,
                dropped: dropped.into_iter().map(|(stage, count)| (stage.to_owned(), count)).collect(),
                readings: stream.readings.iter().map(|(name, &value)| (name.clone(), Some(value))).collect(),
            };
            (stream.id.clone(), entry)
        });
        let status = container::Status {
            host_ns: status.host_ns,
            written_bytes: self.writer.written_bytes(),
            disk_free_bytes: (status.disk.total > 0).then_some(status.disk.free),
            streams: streams.collect(),
        };
        self.writer.status(&status).map_err(|error| sort(&self.path, error))
    }

    fn flush(&mut self) -> Result<(), SinkError> {
        self.writer.flush().map_err(|error| sort(&self.path, error))
    }

    fn bytes_written(&self) -> u64 {
        self.writer.written_bytes()
    }

    fn finish(self: Box<Self>) -> Result<u64, SinkError> {
        let Self { path, writer, .. } = *self;
        let finished = writer.finish().map_err(|error| sort(&path, error))?;
        let mut sink = finished.sink;
        sink.flush().map_err(|error| SinkError::io(&path, error))?;
        Ok(finished.bytes)
    }
}

fn sort(path: &Path, error: ContainerError) -> SinkError {
    match error {
        ContainerError::Write { source, .. } => SinkError::io(path, source),
        other => SinkError::Container { path: path.to_path_buf(), message: other.to_string() },
    }
}

/// What helps to understand a recording later.
pub struct MachineFacts;

impl MachineFacts {
    /// Kernel, architecture, name, clock source, and how `uvcvideo` stamps frames, as far as the system says.
    #[must_use]
    pub fn gather() -> BTreeMap<String, String> {
        let mut facts = BTreeMap::from([
            ("system".to_owned(), std::env::consts::OS.to_owned()),
            ("architecture".to_owned(), std::env::consts::ARCH.to_owned()),
        ]);
        #[cfg(unix)]
        {
            let uname = rustix::system::uname();
            facts.insert("kernel".to_owned(), uname.release().to_string_lossy().into_owned());
            facts.insert("host".to_owned(), uname.nodename().to_string_lossy().into_owned());
        }
        for (name, path) in [
            ("clocksource", "/sys/devices/system/clocksource/clocksource0/current_clocksource"),
            ("uvcvideo.hwtimestamps", "/sys/module/uvcvideo/parameters/hwtimestamps"),
            ("uvcvideo.clock", "/sys/module/uvcvideo/parameters/clock"),
            ("usbfs_memory_mb", "/sys/module/usbcore/parameters/usbfs_memory_mb"),
        ] {
            if let Ok(value) = std::fs::read_to_string(path) {
                facts.insert(name.to_owned(), value.trim().to_owned());
            }
        }
        facts
    }
}
