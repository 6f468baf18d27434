//! Writing a session.
//!
//! The sink sees whole chunks: they are put together in memory and handed over in one write, so that a program killed
//! at any moment leaves a file whose last chunk alone may be cut. A chunk closes when it is [`Settings::chunk_bytes`]
//! long or [`Settings::chunk_ns`] old, whichever comes first.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use super::states::StateKeeper;
use crate::{
    clock::ClockFit,
    container::{
        ContainerError, DecoderState,
        packet::{self, HEADER_BYTES},
        record::{
            DESCRIPTION_KEY, INCIDENT_TOPIC, IncidentEntry, RIG_ATTACHMENT, SESSION_METADATA, STATUS_TOPIC,
            SessionStart, Status, StreamTotals, TOTALS_METADATA, Totals, clock_topic, json_text, plain_id, state_topic,
            topic,
        },
    },
    source::{Description, Incident, Packet, StampClock},
};
use mcap::{
    records::{MessageHeader, Metadata},
    write::NoSeek,
};

/// How a session is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// A chunk closes once it is longer than this.
    pub chunk_bytes: u64,
    /// A chunk closes once its first message is older than this, nanoseconds of host time.
    pub chunk_ns: i64,
    /// Whether every chunk carries the CRC-32 of its content, so that readers notice damage.
    pub crc: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { chunk_bytes: 4 << 20, chunk_ns: 500_000_000, crc: true }
    }
}

/// Names a stream towards the writer that handed it out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct StreamId(usize);

/// A stream of the file that is being written.
struct WrittenStream {
    id: String,
    channel: u16,
    clock: u16,
    state: u16,
    keeper: Option<StateKeeper>,
    totals: StreamTotals,
}

/// What [`SessionWriter::finish`] hands back.
#[derive(Debug)]
pub struct Finished<W> {
    /// What was recorded.
    pub totals: Totals,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// The sink, flushed; a caller that wants the file on the disk before it goes on calls [`File::sync_all`].
    pub sink: W,
}

/// Writes one session.
pub struct SessionWriter<W: Write> {
    path: PathBuf,
    start: SessionStart,
    settings: Settings,
    writer: mcap::Writer<NoSeek<Counted<W>>>,
    written: Arc<AtomicU64>,
    streams: Vec<WrittenStream>,
    packet_schema: u16,
    clock_schema: u16,
    state_schema: u16,
    status: u16,
    incidents: u16,
    chunk_since_ns: Option<i64>,
    totals: Totals,
    scratch: Vec<u8>,
}

impl SessionWriter<File> {
    /// Creates the file `path`, which must not exist, and writes what is known of the session: `start`, and the rig's
    /// configuration as it was read (`rig`, may be empty).
    ///
    /// # Errors
    /// If the file exists or cannot be written.
    pub fn create(path: &Path, start: SessionStart, rig: &str, settings: Settings) -> Result<Self, ContainerError> {
        let file = File::create_new(path).map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => ContainerError::Exists { path: path.to_owned() },
            _ => ContainerError::Open { what: "create", path: path.to_owned(), source },
        })?;
        Self::new(file, path, start, rig, settings)
    }
}

impl<W: Write> SessionWriter<W> {
    /// As [`SessionWriter::create`], into any sink; `path` names it in errors.
    ///
    /// # Errors
    /// If the sink fails.
    pub fn new(
        sink: W,
        path: &Path,
        start: SessionStart,
        rig: &str,
        settings: Settings,
    ) -> Result<Self, ContainerError> {
        let path = path.to_owned();
        let written = Arc::new(AtomicU64::new(0));
        // Whole chunks pass the buffer by; it gathers the small records between them.
        let sink = Counted { inner: BufWriter::with_capacity(1 << 16, sink), written: written.clone() };
        let failed = |error| ContainerError::writing(&path, written.load(Ordering::Relaxed), error);
        let mut writer = mcap::WriteOptions::new()
            .compression(None)
            .profile("erfgs")
            .library(concat!("erfgs ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(settings.chunk_bytes))
            .disable_seeking(true)
            .calculate_chunk_crcs(settings.crc)
            // The CRC of all chunks together says nothing that theirs do not.
            .calculate_data_section_crc(false)
            .create(NoSeek::new(sink))
            .map_err(failed)?;
        let mut begin = || {
            let metadata = start.to_metadata();
            writer.write_metadata(&Metadata { name: SESSION_METADATA.to_owned(), metadata })?;
            if !rig.is_empty() {
                let time = start.log_time(start.host_ns);
                writer.attach(&mcap::Attachment {
                    log_time: time,
                    create_time: time,
                    name: RIG_ATTACHMENT.to_owned(),
                    media_type: "application/toml".to_owned(),
                    data: rig.as_bytes().into(),
                })?;
            }
            let packets = writer.add_schema(packet::SCHEMA_NAME, "ros2msg", packet::SCHEMA.as_bytes())?;
            let mut json = |name: &str, schema: &str| writer.add_schema(name, "jsonschema", schema.as_bytes());
            let clock = json("erfgs.ClockFit", include_str!("schema/clock_fit.json"))?;
            let state = json("erfgs.DecoderState", include_str!("schema/decoder_state.json"))?;
            let status = json("erfgs.Status", include_str!("schema/status.json"))?;
            let incident = json("erfgs.Incident", include_str!("schema/incident.json"))?;
            let status = writer.add_channel(status, STATUS_TOPIC, "json", &BTreeMap::new())?;
            let incidents = writer.add_channel(incident, INCIDENT_TOPIC, "json", &BTreeMap::new())?;
            // What was written so far is on its way to the disk before the first packet arrives.
            writer.flush()?;
            Ok((packets, clock, state, status, incidents))
        };
        let (packet_schema, clock_schema, state_schema, status, incidents) = begin().map_err(failed)?;
        Ok(Self {
            path,
            start,
            settings,
            writer,
            written,
            streams: Vec::new(),
            packet_schema,
            clock_schema,
            state_schema,
            status,
            incidents,
            chunk_since_ns: None,
            totals: Totals::default(),
            scratch: Vec::new(),
        })
    }

    /// When the recording started.
    #[must_use]
    pub fn start(&self) -> &SessionStart {
        &self.start
    }

    /// Bytes of the file so far, without the chunk that is being put together.
    #[must_use]
    pub fn written_bytes(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// Adds a stream. May be called at any time before [`SessionWriter::finish`]. What declares the stream goes to the
    /// system at once, in a chunk of its own, so that it is not lost with the first packets.
    ///
    /// # Errors
    /// If the id is taken or cannot be part of a topic, or writing fails.
    pub fn add_stream(&mut self, description: &Description) -> Result<StreamId, ContainerError> {
        let id = &description.id;
        let path = || self.path.clone();
        if plain_id(id) != *id {
            return Err(ContainerError::StreamName { path: path(), id: id.clone() });
        }
        if self.streams.iter().any(|stream| stream.id == *id) {
            return Err(ContainerError::DuplicateStream { path: path(), id: id.clone() });
        }
        let metadata = BTreeMap::from([(DESCRIPTION_KEY.to_owned(), json_text(description))]);
        let plain = BTreeMap::new();
        let mut add =
            |schema, topic: &str, encoding, metadata| self.writer.add_channel(schema, topic, encoding, metadata);
        let channels =
            add(self.packet_schema, &topic(id, description.encoding), "cdr", &metadata).and_then(|channel| {
                let clock = add(self.clock_schema, &clock_topic(id), "json", &plain)?;
                Ok((channel, clock, add(self.state_schema, &state_topic(id), "json", &plain)?))
            });
        let (channel, clock, state) = channels.map_err(|error| self.failed(error))?;
        let keeper = StateKeeper::new(description);
        let totals = StreamTotals::default();
        self.streams.push(WrittenStream { id: id.clone(), channel, clock, state, keeper, totals });
        self.flush()?;
        Ok(StreamId(self.streams.len() - 1))
    }

    /// Writes a packet of a stream. Packets of one stream come in the order of their sequence numbers.
    ///
    /// # Errors
    /// If writing fails; nothing can be written after that.
    pub fn packet(&mut self, stream: StreamId, packet: &Packet) -> Result<(), ContainerError> {
        let entry = &mut self.streams[stream.0];
        if u32::try_from(packet.payload.len()).is_err() {
            return Err(ContainerError::TooLong { id: entry.id.clone(), bytes: packet.payload.len() });
        }
        entry.totals.count(packet);
        let channel = entry.channel;
        if let Some(state) = entry.keeper.as_mut().and_then(|keeper| keeper.take(packet)) {
            self.decoder_state(stream, packet.host_ns, packet.sequence, state)?;
        }
        let mut data = std::mem::take(&mut self.scratch);
        data.clear();
        data.reserve(HEADER_BYTES + packet.payload.len());
        data.extend_from_slice(&packet::header(packet));
        data.extend_from_slice(&packet.payload);
        // What MCAP calls the publish time is when the data came to be, as far as that is known here.
        let publish_ns = match packet.stamp {
            Some(stamp) if stamp.clock == StampClock::Monotonic => stamp.kernel_ns,
            _ => packet.host_ns,
        };
        let written = self.message(channel, packet.sequence as u32, packet.host_ns, publish_ns, &data);
        self.scratch = data;
        written
    }

    /// Notes what happened to a stream, or to the recorder itself (`None`).
    ///
    /// # Errors
    /// If writing fails.
    pub fn incident(
        &mut self,
        stream: Option<StreamId>,
        host_ns: i64,
        incident: &Incident,
    ) -> Result<(), ContainerError> {
        let stream = stream.map_or(String::new(), |stream| self.streams[stream.0].id.clone());
        let entry = IncidentEntry { stream, host_ns, incident: incident.clone() };
        let written = self.message(self.incidents, 0, host_ns, host_ns, json_text(&entry).as_bytes());
        self.totals.note(entry);
        written
    }

    /// Notes the state of the recorder: counters and drops of every stream, readings of the devices.
    ///
    /// # Errors
    /// If writing fails.
    pub fn status(&mut self, status: &Status) -> Result<(), ContainerError> {
        self.totals.status = Some(status.clone());
        self.message(self.status, 0, status.host_ns, status.host_ns, json_text(status).as_bytes())
    }

    /// Notes how a stream's ticks map to session time, as known at `host_ns`.
    ///
    /// # Errors
    /// If writing fails.
    pub fn clock(&mut self, stream: StreamId, host_ns: i64, fit: &ClockFit) -> Result<(), ContainerError> {
        let entry = &self.streams[stream.0];
        self.totals.clocks.insert(entry.id.clone(), fit.clone());
        let channel = entry.clock;
        self.message(channel, 0, host_ns, host_ns, json_text(fit).as_bytes())
    }

    /// Notes the state of a stream's decoder before the packet `sequence`, so that decoding can start there.
    fn decoder_state(
        &mut self,
        stream: StreamId,
        host_ns: i64,
        sequence: u64,
        state: [u8; 16],
    ) -> Result<(), ContainerError> {
        let entry = &self.streams[stream.0];
        let channel = entry.state;
        let state = DecoderState { stream: entry.id.clone(), host_ns, sequence, state };
        self.message(channel, sequence as u32, host_ns, host_ns, json_text(&state).as_bytes())
    }

    /// Closes the chunk if it is old enough. To be called at least a few times a second, also when nothing arrives.
    ///
    /// # Errors
    /// If writing fails.
    pub fn flush_if_due(&mut self, host_ns: i64) -> Result<(), ContainerError> {
        match self.chunk_since_ns {
            Some(since) if host_ns.saturating_sub(since) >= self.settings.chunk_ns => self.flush(),
            _ => Ok(()),
        }
    }

    /// Closes the chunk and hands everything to the system.
    ///
    /// # Errors
    /// If writing fails.
    pub fn flush(&mut self) -> Result<(), ContainerError> {
        self.chunk_since_ns = None;
        self.writer.flush().map_err(|error| self.failed(error))
    }

    /// Writes the totals and the index, and hands back the sink.
    ///
    /// # Errors
    /// If writing fails; the chunks written before stay readable.
    pub fn finish(mut self) -> Result<Finished<W>, ContainerError> {
        let mut totals = std::mem::take(&mut self.totals);
        totals.streams = self.streams.iter().map(|stream| (stream.id.clone(), stream.totals)).collect();
        let metadata = totals.to_metadata();
        self.writer
            .write_metadata(&Metadata { name: TOTALS_METADATA.to_owned(), metadata })
            .and_then(|()| self.writer.finish().map(drop))
            .map_err(|error| self.failed(error))?;
        let Self { path, writer, written, .. } = self;
        let bytes = written.load(Ordering::Relaxed);
        let sink = writer.into_inner().into_inner().inner.into_inner();
        let sink = sink.map_err(|error| ContainerError::Write { path, offset: bytes, source: error.into_error() })?;
        Ok(Finished { totals, bytes, sink })
    }

    fn message(
        &mut self,
        channel_id: u16,
        sequence: u32,
        host_ns: i64,
        publish_ns: i64,
        data: &[u8],
    ) -> Result<(), ContainerError> {
        self.flush_if_due(host_ns)?;
        let before = self.written_bytes();
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time: self.start.log_time(host_ns),
            publish_time: self.start.log_time(publish_ns),
        };
        self.writer.write_to_known_channel(&header, data).map_err(|error| self.failed(error))?;
        // The writer closes a chunk that is long enough before it takes the next message.
        if self.written_bytes() != before {
            self.chunk_since_ns = None;
        }
        self.chunk_since_ns.get_or_insert(host_ns);
        Ok(())
    }

    fn failed(&self, error: mcap::McapError) -> ContainerError {
        ContainerError::writing(&self.path, self.written_bytes(), error)
    }
}

/// Counts the bytes on their way to the sink.
struct Counted<W: Write> {
    inner: BufWriter<W>,
    written: Arc<AtomicU64>,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.written.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
