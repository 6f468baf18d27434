//! Writing a session, into one file or several.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Write},
    path::Path,
};

use super::{
    Split,
    output::{About, Channels, Numbers, Output},
    states::StateKeeper,
};
use crate::{
    clock::ClockFit,
    container::{
        ContainerError, DecoderState, MAX_PART, PartOf, SessionId,
        packet::{self, HEADER_BYTES},
        record::{IncidentEntry, SessionStart, Status, StreamTotals, Totals, json_text, plain_id},
    },
    source::{Description, Incident, Packet, StampClock, merge_settings},
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
    description: Description,
    channels: Channels,
    keeper: Option<StateKeeper>,
    totals: StreamTotals,
}

/// What [`SessionWriter::finish`] and [`SessionWriter::change_to`] hand back.
#[derive(Debug)]
pub struct Finished<W> {
    /// What the file holds; of a session in several files those before are not counted.
    pub totals: Totals,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// The sink, flushed; a caller that wants the file on the disk before it goes on calls [`File::sync_all`].
    pub sink: W,
}

/// The next file of a session, begun by [`SessionWriter::next_part`]: all streams are declared in it.
pub struct NextPart<W: Write> {
    part: PartOf,
    output: Output<W>,
    channels: Vec<Channels>,
}

/// Writes one session.
pub struct SessionWriter<W: Write> {
    start: SessionStart,
    rig: String,
    settings: Settings,
    output: Output<W>,
    /// Of a session in several files: which this is.
    part: Option<PartOf>,
    /// What was changed so far, by the stream's id.
    adjusted: BTreeMap<String, serde_json::Map<String, serde_json::Value>>,
    /// Bytes of the files before.
    before_bytes: u64,
    streams: Vec<WrittenStream>,
    totals: Totals,
    /// Bytes that incidents take in the totals, at most.
    noted_bytes: u64,
    /// The same of the last status.
    status_bytes: u64,
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
        // A file that could not be begun would be in the way of the next try.
        Self::new(file, path, start, rig, settings).inspect_err(|_| drop(std::fs::remove_file(path)))
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
        Self::begin(sink, path, start, rig, settings, None)
    }

    /// As [`SessionWriter::new`], of a session that may go on in further files ([`SessionWriter::next_part`]) and is told from all
    /// others by `session`.
    ///
    /// # Errors
    /// If the sink fails.
    pub fn in_parts(
        sink: W,
        path: &Path,
        start: SessionStart,
        rig: &str,
        settings: Settings,
        session: SessionId,
    ) -> Result<Self, ContainerError> {
        let part = PartOf { session, number: 0, adjusted: BTreeMap::new() };
        Self::begin(sink, path, start, rig, settings, Some(part))
    }

    fn begin(
        sink: W,
        path: &Path,
        start: SessionStart,
        rig: &str,
        settings: Settings,
        part: Option<PartOf>,
    ) -> Result<Self, ContainerError> {
        let output = Output::begin(sink, path, &About { start: &start, part: part.as_ref(), rig }, settings)?;
        Ok(Self {
            start,
            rig: rig.to_owned(),
            settings,
            output,
            part,
            adjusted: BTreeMap::new(),
            before_bytes: 0,
            streams: Vec::new(),
            totals: Totals::default(),
            noted_bytes: 0,
            status_bytes: 0,
            scratch: Vec::new(),
        })
    }

    /// When the recording started.
    #[must_use]
    pub fn start(&self) -> &SessionStart {
        &self.start
    }

    /// Bytes of all files so far, without the chunk that is being put together.
    #[must_use]
    pub fn written_bytes(&self) -> u64 {
        self.before_bytes + self.output.written_bytes()
    }

    /// Bytes of the files before the present one.
    #[must_use]
    pub fn before_bytes(&self) -> u64 {
        self.before_bytes
    }

    /// Adds a stream. May be called at any time before [`SessionWriter::finish`]. What declares the stream goes to the
    /// system at once, in a chunk of its own, so that it is not lost with the first packets.
    ///
    /// # Errors
    /// If the id is taken or cannot be part of a topic, or writing fails.
    pub fn add_stream(&mut self, description: &Description) -> Result<StreamId, ContainerError> {
        let id = &description.id;
        let path = || self.output.path().to_owned();
        if plain_id(id) != *id {
            return Err(ContainerError::StreamName { path: path(), id: id.clone() });
        }
        if self.streams.iter().any(|stream| stream.description.id == *id) {
            return Err(ContainerError::DuplicateStream { path: path(), id: id.clone() });
        }
        let channels = self.output.add_stream(description)?;
        let keeper = StateKeeper::new(description);
        let (description, totals) = (description.clone(), StreamTotals::default());
        self.streams.push(WrittenStream { description, channels, keeper, totals });
        Ok(StreamId(self.streams.len() - 1))
    }

    /// Whether `packet` belongs into the next file.
    #[must_use]
    pub fn is_full(&self, split: Split, packet: &Packet) -> bool {
        let totals = || self.streams.iter().map(|stream| &stream.totals);
        let first_ns = totals().filter_map(|totals| totals.first_host_ns).min();
        let (Some(first_ns), Some(part)) = (first_ns, &self.part) else { return false };
        let full = match split {
            Split::Time(ns) => packet.host_ns.saturating_sub(first_ns) >= ns,
            Split::Bytes(bytes) => {
                // A state of the decoder may go before it.
                let message = HEADER_BYTES + packet.payload.len() + STATE_BYTES;
                self.output.length_with(message as u64, self.totals_bytes()) > bytes
            }
        };
        full && part.number < MAX_PART
    }

    /// Bytes of what is said in sum at the end of the file, at most.
    fn totals_bytes(&self) -> u64 {
        self.noted_bytes + self.status_bytes + (self.streams.len() * STREAM_TOTALS_BYTES) as u64
    }

    /// Begins the next file of a session in parts. Nothing changes yet: [`SessionWriter::change_to`] ends the present one.
    ///
    /// # Errors
    /// If the sink fails, or the session is none in parts; the present file can be written on then.
    pub fn next_part(&self, sink: W, path: &Path) -> Result<NextPart<W>, ContainerError> {
        let Some(PartOf { session, number, .. }) = self.part.as_ref().filter(|part| part.number < MAX_PART) else {
            return Err(ContainerError::NotInParts { path: self.output.path().to_owned() });
        };
        let part = PartOf { session: *session, number: number + 1, adjusted: self.adjusted.clone() };
        let about = About { start: &self.start, part: Some(&part), rig: &self.rig };
        let mut output = Output::begin(sink, path, &about, self.settings)?;
        let streams = self.streams.iter();
        let channels = streams.map(|stream| output.add_stream(&stream.description)).collect::<Result<_, _>>()?;
        Ok(NextPart { part, output, channels })
    }

    /// Ends the present file and goes on in the next one. Each stream of events begins there with the state of its decoder.
    ///
    /// # Errors
    /// If the end of the present file cannot be written; what is written from then on lies in the next one all the same.
    pub fn change_to(&mut self, next: NextPart<W>) -> Result<Finished<W>, ContainerError> {
        let NextPart { part, output, channels } = next;
        let before = std::mem::replace(&mut self.output, output);
        let mut totals = self.take_totals();
        totals.continues = true;
        self.part = Some(part);
        for (stream, channels) in self.streams.iter_mut().zip(channels) {
            stream.channels = channels;
            if let Some(keeper) = &mut stream.keeper {
                keeper.want_state();
            }
        }
        self.before_bytes += before.written_bytes();
        let written = before.written_bytes();
        let finished = before.finish(totals)?;
        self.before_bytes += finished.bytes - written;
        Ok(finished)
    }

    /// Which part the present file is, counted from 0.
    #[must_use]
    pub fn part_number(&self) -> u32 {
        self.part.as_ref().map_or(0, |part| part.number)
    }

    /// Writes a packet of a stream. Packets of one stream come in the order of their sequence numbers.
    ///
    /// # Errors
    /// If writing fails; nothing can be written after that.
    pub fn packet(&mut self, stream: StreamId, packet: &Packet) -> Result<(), ContainerError> {
        let entry = &mut self.streams[stream.0];
        if u32::try_from(packet.payload.len()).is_err() {
            return Err(ContainerError::TooLong { id: entry.description.id.clone(), bytes: packet.payload.len() });
        }
        entry.totals.count(packet);
        let channel = entry.channels.packets;
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
        let numbers = Numbers { channel, sequence: packet.sequence as u32, host_ns: packet.host_ns, publish_ns };
        let written = self.output.message(&self.start, &numbers, &data);
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
        let stream = stream.map_or(String::new(), |stream| self.streams[stream.0].description.id.clone());
        if let Incident::Adjusted { changed } = incident
            && self.part.is_some()
        {
            merge_settings(self.adjusted.entry(stream.clone()).or_default(), changed);
        }
        let entry = IncidentEntry { stream, host_ns, incident: incident.clone() };
        let text = json_text(&entry);
        let written = self.note(self.output.incidents, 0, host_ns, &text);
        if self.totals.incidents.len() < Totals::MAX_INCIDENTS {
            self.noted_bytes += text.len() as u64 + 1;
        }
        self.totals.note(entry);
        written
    }

    /// Notes the state of the recorder: counters and drops of every stream, readings of the devices.
    ///
    /// # Errors
    /// If writing fails.
    pub fn status(&mut self, status: &Status) -> Result<(), ContainerError> {
        let text = json_text(status);
        self.status_bytes = text.len() as u64;
        self.totals.status = Some(status.clone());
        self.note(self.output.status, 0, status.host_ns, &text)
    }

    /// Notes how a stream's ticks map to session time, as known at `host_ns`.
    ///
    /// # Errors
    /// If writing fails.
    pub fn clock(&mut self, stream: StreamId, host_ns: i64, fit: &ClockFit) -> Result<(), ContainerError> {
        let entry = &self.streams[stream.0];
        self.totals.clocks.insert(entry.description.id.clone(), fit.clone());
        self.note(entry.channels.clock, 0, host_ns, &json_text(fit))
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
        let channel = entry.channels.state;
        let state = DecoderState { stream: entry.description.id.clone(), host_ns, sequence, state };
        self.note(channel, sequence as u32, host_ns, &json_text(&state))
    }

    /// Closes the chunk if it is old enough. To be called at least a few times a second, also when nothing arrives.
    ///
    /// # Errors
    /// If writing fails.
    pub fn flush_if_due(&mut self, host_ns: i64) -> Result<(), ContainerError> {
        self.output.flush_if_due(host_ns)
    }

    /// Closes the chunk and hands everything to the system.
    ///
    /// # Errors
    /// If writing fails.
    pub fn flush(&mut self) -> Result<(), ContainerError> {
        self.output.flush()
    }

    /// Writes the totals and the index, and hands back the sink.
    ///
    /// # Errors
    /// If writing fails; the chunks written before stay readable.
    pub fn finish(mut self) -> Result<Finished<W>, ContainerError> {
        let totals = self.take_totals();
        self.output.finish(totals)
    }

    /// What the present file holds; what follows is counted from nothing.
    fn take_totals(&mut self) -> Totals {
        let mut totals = std::mem::take(&mut self.totals);
        (self.noted_bytes, self.status_bytes) = (0, 0);
        let streams = self.streams.iter_mut();
        totals.streams =
            streams.map(|stream| (stream.description.id.clone(), std::mem::take(&mut stream.totals))).collect();
        totals
    }

    /// Writes a message of text.
    fn note(&mut self, channel: u16, sequence: u32, host_ns: i64, text: &str) -> Result<(), ContainerError> {
        let numbers = Numbers { channel, sequence, host_ns, publish_ns: host_ns };
        self.output.message(&self.start, &numbers, text.as_bytes())
    }
}

/// A state of a decoder as a message, with its place in the indexes, at most.
const STATE_BYTES: usize = 512;
/// What is said of a stream in sum, and of its clock, at most.
const STREAM_TOTALS_BYTES: usize = 1536;
