//! One file that is being written: its records, its channels, and the chunk that is put together.
//!
//! The sink sees whole chunks: they are put together in memory and handed over in one write, so that a program killed
//! at any moment leaves a file whose last chunk alone may be cut. A chunk closes when it is [`Settings::chunk_bytes`]
//! long or [`Settings::chunk_ns`] old, whichever comes first.

use std::{
    collections::BTreeMap,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use super::{Finished, Settings};
use crate::{
    container::{
        ContainerError, PartOf, packet,
        parts::PART_METADATA,
        record::{
            DESCRIPTION_KEY, INCIDENT_TOPIC, RIG_ATTACHMENT, SESSION_METADATA, STATUS_TOPIC, SessionStart,
            TOTALS_METADATA, Totals, clock_topic, json_text, state_topic, topic,
        },
    },
    source::Description,
};
use mcap::{
    records::{MessageHeader, Metadata},
    write::NoSeek,
};

/// The record of a message without its data: opcode, length, and the numbers before the data.
const MESSAGE_BYTES: u64 = 9 + 22;
/// A message's entry in the index behind its chunk.
const INDEX_BYTES: u64 = 16;
/// What a chunk takes for each channel: the record of its index, and where that lies.
const CHANNEL_BYTES: u64 = 15 + 10;
/// What a chunk takes besides: its own fields, and those of its entry in the index at the end.
const CHUNK_BYTES: u64 = 49 + 96;
/// What the end of a file takes besides: footer, statistics, where everything lies.
const END_BYTES: u64 = 4096;

/// What a file is about, whatever streams it has.
pub(super) struct About<'a> {
    pub start: &'a SessionStart,
    pub part: Option<&'a PartOf>,
    pub rig: &'a str,
}

/// The channels of a stream.
#[derive(Clone, Copy)]
pub(super) struct Channels {
    pub packets: u16,
    pub clock: u16,
    pub state: u16,
}

/// The numbers of a message.
pub(super) struct Numbers {
    pub channel: u16,
    pub sequence: u32,
    pub host_ns: i64,
    pub publish_ns: i64,
}

/// See the module.
pub(super) struct Output<W: Write> {
    path: PathBuf,
    settings: Settings,
    writer: mcap::Writer<NoSeek<Counted<W>>>,
    written: Arc<AtomicU64>,
    packet_schema: u16,
    clock_schema: u16,
    state_schema: u16,
    pub status: u16,
    pub incidents: u16,
    channels: u64,
    chunk_since_ns: Option<i64>,
    /// Bytes that the chunk takes which is put together, and its index.
    chunk_bytes: u64,
    /// Bytes that the index at the end takes for the chunks before.
    index_bytes: u64,
    /// Bytes of what declares the channels, which the end repeats.
    declared_bytes: u64,
}

impl<W: Write> Output<W> {
    /// Begins a file with what is known of the session. `path` names it in errors.
    pub fn begin(sink: W, path: &Path, about: &About<'_>, settings: Settings) -> Result<Self, ContainerError> {
        let About { start, part, rig } = *about;
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
            if let Some(part) = part {
                let metadata = part.to_metadata();
                writer.write_metadata(&Metadata { name: PART_METADATA.to_owned(), metadata })?;
            }
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
        let declared_bytes = written.load(Ordering::Relaxed);
        Ok(Self {
            path,
            settings,
            writer,
            written,
            packet_schema,
            clock_schema,
            state_schema,
            status,
            incidents,
            channels: 2,
            chunk_since_ns: None,
            chunk_bytes: 0,
            index_bytes: 0,
            declared_bytes,
        })
    }

    /// The file's name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of the file so far, without the chunk that is being put together.
    pub fn written_bytes(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// How long the file may become if it ends after another message of so many bytes, and `totals_bytes` are said of it in sum.
    pub fn length_with(&self, message_bytes: u64, totals_bytes: u64) -> u64 {
        let chunk = self.chunk_bytes + CHUNK_BYTES + CHANNEL_BYTES * self.channels;
        let message = message_bytes + MESSAGE_BYTES + INDEX_BYTES;
        let end = self.index_bytes + self.declared_bytes + totals_bytes + END_BYTES;
        self.written_bytes() + chunk + message + end
    }

    /// Declares a stream, in a chunk of its own, which goes to the system at once.
    pub fn add_stream(&mut self, description: &Description) -> Result<Channels, ContainerError> {
        let before = self.written_bytes();
        let id = &description.id;
        let metadata = BTreeMap::from([(DESCRIPTION_KEY.to_owned(), json_text(description))]);
        let plain = BTreeMap::new();
        let mut add =
            |schema, topic: &str, encoding, metadata| self.writer.add_channel(schema, topic, encoding, metadata);
        let channels =
            add(self.packet_schema, &topic(id, description.encoding), "cdr", &metadata).and_then(|packets| {
                let clock = add(self.clock_schema, &clock_topic(id), "json", &plain)?;
                Ok(Channels { packets, clock, state: add(self.state_schema, &state_topic(id), "json", &plain)? })
            });
        let channels = channels.map_err(|error| self.failed(error))?;
        self.channels += 3;
        self.flush()?;
        self.index_bytes += CHUNK_BYTES;
        self.declared_bytes += self.written_bytes() - before;
        Ok(channels)
    }

    /// Writes a message.
    pub fn message(&mut self, start: &SessionStart, numbers: &Numbers, data: &[u8]) -> Result<(), ContainerError> {
        let &Numbers { channel, sequence, host_ns, publish_ns } = numbers;
        self.flush_if_due(host_ns)?;
        let before = self.written_bytes();
        let header = MessageHeader {
            channel_id: channel,
            sequence,
            log_time: start.log_time(host_ns),
            publish_time: start.log_time(publish_ns),
        };
        self.writer.write_to_known_channel(&header, data).map_err(|error| self.failed(error))?;
        // The writer closes a chunk that is long enough before it takes the next message.
        if self.written_bytes() != before {
            self.chunk_is_over();
        }
        self.chunk_bytes += MESSAGE_BYTES + INDEX_BYTES + data.len() as u64;
        self.chunk_since_ns.get_or_insert(host_ns);
        Ok(())
    }

    fn chunk_is_over(&mut self) {
        if self.chunk_bytes > 0 {
            self.index_bytes += CHUNK_BYTES + CHANNEL_BYTES * self.channels;
        }
        (self.chunk_since_ns, self.chunk_bytes) = (None, 0);
    }

    /// Closes the chunk if it is old enough.
    pub fn flush_if_due(&mut self, host_ns: i64) -> Result<(), ContainerError> {
        match self.chunk_since_ns {
            Some(since) if host_ns.saturating_sub(since) >= self.settings.chunk_ns => self.flush(),
            _ => Ok(()),
        }
    }

    /// Closes the chunk and hands everything to the system.
    pub fn flush(&mut self) -> Result<(), ContainerError> {
        self.chunk_is_over();
        self.writer.flush().map_err(|error| self.failed(error))
    }

    /// Writes the totals and the index, and hands back the sink.
    pub fn finish(mut self, totals: Totals) -> Result<Finished<W>, ContainerError> {
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
