//! The sink of a recording: a session in the MCAP container, in one file or several.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

use erfgs_base::FileError;
use erfgs_session::{
    clock::ClockFit,
    container::{self, ContainerError, SessionId, SessionStart, SessionWriter, Settings, Split, StreamId},
    source::{Description, Incident, Packet},
};

use erfgs_rig::host_time::host_ns;

use super::{
    files::Files,
    sink::{OpenSession, SessionInfo, SessionSink, SinkError},
    status::{Level, Status},
};

/// Opens session files.
#[derive(Clone, Copy, Debug, Default)]
pub struct SessionFiles {
    /// How they are written.
    pub settings: Settings,
    /// When a session goes on in another file; `None`: never.
    pub split: Option<Split>,
}

impl SessionFiles {
    /// A session into any writer, in one piece; `path` names it in errors.
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
        let begin = |start| SessionWriter::new(writer, path, start, &info.configuration, self.settings);
        Ok(Box::new(SessionFileSink::begin(path, info, streams, None, begin)?))
    }
}

impl OpenSession for SessionFiles {
    fn open(
        &self,
        path: &Path,
        info: &SessionInfo,
        streams: &[Description],
    ) -> Result<Box<dyn SessionSink>, SinkError> {
        let Some(split) = self.split else {
            let file = File::create_new(path).map_err(|error| not_made(path, error))?;
            return self.write_to(file, path, info, streams).map_err(|error| not_begun(path, error));
        };
        // Files of this name are parts of another session, and are never overwritten.
        let taken = container::parts_beside(path).map_err(|error| not_made(path, error))?;
        if let Some((_, taken)) = taken.into_iter().next() {
            return Err(SinkError::Exists(taken));
        }
        let mut id = [0; 16];
        getrandom::fill(&mut id).map_err(SinkError::Random)?;
        let file = File::create_new(path).map_err(|error| not_made(path, error))?;
        let begin =
            |start| SessionWriter::in_parts(file, path, start, &info.configuration, self.settings, SessionId(id));
        let begun = SessionFileSink::begin(path, info, streams, Some(Files::new(path, split)), begin);
        Ok(Box::new(begun.map_err(|error| not_begun(path, error))?))
    }
}

/// Why a file could not be made for a session.
pub(super) fn not_made(path: &Path, source: io::Error) -> SinkError {
    match source.kind() {
        io::ErrorKind::AlreadyExists => SinkError::Exists(path.to_owned()),
        _ => SinkError::NotBegun(FileError::when("begin", path)(source)),
    }
}

/// Why nothing could be written into a file that was made for a session. It goes: it holds no packet, and would be in the way of the
/// next try.
pub(super) fn not_begun(path: &Path, error: SinkError) -> SinkError {
    let _ = fs::remove_file(path);
    match error {
        SinkError::Full(_) => not_made(path, io::ErrorKind::StorageFull.into()),
        SinkError::Io { source, .. } => not_made(path, source),
        other => other,
    }
}

struct SessionFileSink<W: Write> {
    path: PathBuf,
    writer: SessionWriter<W>,
    ids: Vec<StreamId>,
    /// Host time of the session's zero, nanoseconds.
    begin: i64,
    /// Of a session in several files: how it goes on.
    files: Option<Files<W>>,
}

impl<W: Write> SessionFileSink<W> {
    fn begin(
        path: &Path,
        info: &SessionInfo,
        streams: &[Description],
        files: Option<Files<W>>,
        writer: impl FnOnce(SessionStart) -> Result<SessionWriter<W>, ContainerError>,
    ) -> Result<Self, SinkError> {
        let failed = |error| sort(path, error);
        let epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let now_ns = host_ns();
        let begin = info.begin_host_ns.unwrap_or(now_ns).min(now_ns);
        let start = SessionStart {
            host_ns: begin,
            epoch_ns: i64::try_from(epoch.as_nanos()).unwrap_or(i64::MAX).saturating_sub(now_ns.saturating_sub(begin)),
            program: info.program.clone(),
            machine: info.machine.clone(),
        };
        let mut writer = writer(start).map_err(failed)?;
        let ids: Result<Vec<StreamId>, _> = streams.iter().map(|stream| writer.add_stream(stream)).collect();
        let ids = ids.map_err(failed)?;
        for message in &info.warnings {
            let warning = Incident::Warning { message: message.clone() };
            writer.incident(None, begin, &warning).map_err(failed)?;
        }
        // The streams are in the file before anything can go wrong.
        writer.flush().map_err(failed)?;
        Ok(Self { path: path.to_path_buf(), writer, ids, begin, files })
    }
}

/// What is known while recording, of an event camera's ticks, which are microseconds, on the session's clock.
fn of_session(fit: &ClockFit, begin: i64) -> ClockFit {
    ClockFit {
        origin_ticks: fit.origin_ticks / 1000,
        origin_ns: fit.origin_ns.saturating_sub(begin),
        ns_per_tick: 1e3 * fit.ns_per_tick,
        window_ticks: fit.window_ticks.map(|ns| ns / 1000),
        ..fit.clone()
    }
}

impl<W: Write + Send> SessionSink for SessionFileSink<W> {
    fn packet(&mut self, stream: usize, packet: &Packet) -> Result<(), SinkError> {
        if let Some(files) = &mut self.files {
            files.change_if_full(&mut self.writer, packet)?;
        }
        self.writer.packet(self.ids[stream], packet).map_err(|error| sort(&self.path, error))
    }

    fn incident(&mut self, stream: Option<usize>, host_ns: i64, incident: &Incident) -> Result<(), SinkError> {
        let stream = stream.map(|stream| self.ids[stream]);
        self.writer.incident(stream, host_ns, incident).map_err(|error| sort(&self.path, error))
    }

    fn status(&mut self, status: &Status) -> Result<(), SinkError> {
        for (stream, &id) in status.streams.iter().zip(&self.ids) {
            let fit = stream.clock.as_ref().and_then(|clock| clock.fit.as_ref());
            let Some(fit) = fit.filter(|_| stream.encoding.is_events()) else { continue };
            let written = self.writer.clock(id, status.host_ns, &of_session(fit, self.begin));
            written.map_err(|error| sort(&self.path, error))?;
        }
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

    fn files(&self) -> u32 {
        self.writer.part_number() + 1
    }

    fn news(&mut self) -> Vec<(Level, String)> {
        self.files.as_mut().map(|files| std::mem::take(&mut files.news)).unwrap_or_default()
    }

    fn finish(self: Box<Self>) -> Result<u64, SinkError> {
        let Self { path, writer, .. } = *self;
        let before = writer.before_bytes();
        let finished = writer.finish().map_err(|error| sort(&path, error))?;
        let mut sink = finished.sink;
        sink.flush().map_err(|error| SinkError::io(&path, error))?;
        Ok(before + finished.bytes)
    }
}

pub(super) fn sort(path: &Path, error: ContainerError) -> SinkError {
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

#[cfg(test)]
mod tests {
    use erfgs_events::EventEncoding;
    use erfgs_scene::pixel::PixelFormat;
    use std::{
        io::Cursor,
        sync::{Arc, Mutex, PoisonError},
    };

    use erfgs_session::{
        clock::{Evidence, Residuals},
        container::Session,
        source::Encoding,
    };

    use super::*;
    use crate::{ClockStatus, StreamStatus, status::blank};

    #[derive(Clone, Default)]
    struct Held(Arc<Mutex<Vec<u8>>>);

    impl Write for Held {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn of_a_session_that_cannot_be_begun_nothing_is_left() {
        let description = Description {
            id: "no name of a stream/".into(),
            model: String::new(),
            serial: String::new(),
            encoding: Encoding::Frames(PixelFormat::Mjpeg),
            width: 640,
            height: 480,
            start_order: 0,
            settings: serde_json::Map::new(),
        };
        for split in [None, Some(Split::Bytes(1 << 20))] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("take.mcap");
            let files = SessionFiles { split, ..SessionFiles::default() };
            assert!(files.open(&path, &SessionInfo::default(), std::slice::from_ref(&description)).is_err());
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{split:?}");
            let absent = folder.path().join("absent/take.mcap");
            let message = files.open(&absent, &SessionInfo::default(), &[]).err().unwrap().to_string();
            assert!(
                message.contains("absent/take.mcap") && !message.contains("recover"),
                "nothing is there: {message}"
            );
        }
        let message = not_begun(Path::new("take.mcap"), SinkError::Full("take.mcap".into())).to_string();
        assert!(message.contains("begin take.mcap") && message.contains("free some space"), "{message}");
        assert!(!message.contains("recover"), "{message}");
    }

    #[test]
    fn what_is_known_of_the_clocks_of_event_cameras_is_in_the_session() {
        let description = |id: &str, encoding| Description {
            id: id.into(),
            model: String::new(),
            serial: String::new(),
            encoding,
            width: 640,
            height: 480,
            start_order: 0,
            settings: serde_json::Map::new(),
        };
        let streams = [
            description("left", Encoding::Events(EventEncoding::Evt3)),
            description("cam", Encoding::Frames(PixelFormat::Mjpeg)),
        ];
        let held = Held::default();
        let path = Path::new("s.mcap");
        let mut sink = SessionFiles::default().write_to(held.clone(), path, &SessionInfo::default(), &streams).unwrap();
        let begin = host_ns();
        let fit = ClockFit {
            evidence: Evidence::Arrival,
            origin_ticks: 7_000_000_000,
            origin_ns: begin + 2_000_000_000,
            ns_per_tick: 1.000_04,
            window_ticks: [4_000_000_000, 9_000_000_000],
            residuals: Residuals { p50_ns: 100.0, p95_ns: 500.0, max_ns: 900.0 },
            samples: 5000,
            outliers: 0,
        };
        let clock = ClockStatus::of("usb arrival", fit);
        let stream = |description: &Description| StreamStatus { clock: Some(clock.clone()), ..blank(description) };
        let status = Status { host_ns: begin, streams: streams.iter().map(stream).collect(), ..Status::default() };
        sink.status(&status).unwrap();
        sink.finish().unwrap();

        let bytes = held.0.lock().unwrap().clone();
        let session = Session::read(Cursor::new(bytes), path).unwrap();
        let clocks = &session.summary().totals.clocks;
        assert_eq!(clocks.keys().collect::<Vec<_>>(), ["left"]);
        let fit = &clocks["left"];
        // A second of the device, which is slow by 40 ppm, after the moment at which both are known; the session began before.
        let later = fit.session_ns(8_000_000) - 3_000_040_000;
        assert!((0..1_000_000_000).contains(&later) && fit.window_ticks == [4_000_000, 9_000_000], "{later}");
        assert_eq!((fit.samples, fit.residuals.p95_ns), (5000, 500.0));
    }
}
