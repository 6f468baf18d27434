//! Reading a session.

use std::{
    fs::File,
    io::{Read, Seek},
    path::{Path, PathBuf},
};

use mcap::records::{Record, op};

use super::{
    framing::Head,
    index::Index,
    layout::Layout,
    messages::{IntoMessages, Messages, Range},
    parse::parse_record,
    unpack::Compression,
    walk::{Item, Walk},
};
#[cfg(feature = "rosbag2")]
use crate::container::foreign::{bag::SQLITE_MAGIC, rosbag2};
use crate::container::{
    ContainerError, Entry, Stream, Summary,
    foreign::bag::recording_file,
    record::{RIG_ATTACHMENT, SESSION_METADATA, SessionStart, TOTALS_METADATA, Totals, VERSION},
};

/// Where a chunk lies, and the log times of its first and last message.
#[derive(Clone, Copy, Debug)]
struct ChunkAt {
    offset: u64,
    end: u64,
}

/// A session file that is open for reading.
pub struct Session<R = File> {
    path: PathBuf,
    walk: Walk<R>,
    summary: Summary,
    chunks: Vec<ChunkAt>,
    /// Whether the index at the end said what there is.
    indexed: bool,
    /// What the end of the file says, if it was closed; of a session also the totals.
    index: Index,
    end_totals: Option<Totals>,
    /// Host times that readers are restricted to.
    window: Option<[i64; 2]>,
}

impl Session<File> {
    /// Opens the session `path`, also a recording of rosbag2 in SQLite (with the feature `rosbag2`) or a folder
    /// with one. A session that was ended properly says at its end what it holds; another one is read
    /// through once.
    ///
    /// # Errors
    /// If the file cannot be read or is no session.
    pub fn open(path: &Path) -> Result<Self, ContainerError> {
        let path = &*recording_file(path)?;
        let open = |source| ContainerError::Open { what: "open", path: path.to_owned(), source };
        erfgs_base::regular::check(path).map_err(open)?;
        let file = File::open(path).map_err(open)?;
        #[cfg(feature = "rosbag2")]
        {
            let mut head = [0; 16];
            let mut start = &file;
            if start.read_exact(&mut head).is_ok() && head == *SQLITE_MAGIC {
                let mut session = Self::read(rosbag2::as_mcap(path)?, path)?;
                // The sizes are those of the copy, which nobody sees.
                session.summary.file_bytes = file.metadata().map_or(0, |metadata| metadata.len());
                session.summary.whole_bytes = session.summary.file_bytes;
                return Ok(session);
            }
            start.rewind().map_err(open)?;
        }
        Self::read(file, path)
    }
}

impl<R: Read + Seek> Session<R> {
    /// As [`Session::open`], from anything that reads; `path` names it in errors.
    ///
    /// # Errors
    /// If it cannot be read or is no session.
    pub fn read(file: R, path: &Path) -> Result<Self, ContainerError> {
        let walk = Walk::open(file, path)?;
        let summary = Summary { file_bytes: walk.framing.length(), ..Summary::default() };
        let (chunks, index) = (Vec::new(), Index::default());
        let path = path.to_owned();
        let mut session = Self { path, walk, summary, chunks, indexed: false, index, end_totals: None, window: None };
        session.indexed = session.read_index()?;
        if session.indexed {
            session.end_totals = Some(session.summary.totals.clone());
        } else {
            session.scan()?;
            if session.summary.complete {
                session.index = session.walk.framing.index_behind(session.summary.whole_bytes)?;
            }
            // What is damaged or lacks may have declared streams, which the index does, too.
            let in_doubt = !session.summary.damage.is_empty() || !session.walk.layout.is_known();
            if in_doubt && !session.index.declared.channels.is_empty() {
                session.scan()?;
            }
            // What is damaged lacks, of course.
            if session.summary.damage.is_empty() {
                session.summary.damage = session.lacking();
            }
        }
        session.complete_summary()?;
        Ok(session)
    }

    /// The file's name.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the session holds.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// The stream of this name.
    ///
    /// # Errors
    /// If there is none; the message lists those that there are.
    pub fn stream(&self, id: &str) -> Result<(usize, &Stream), ContainerError> {
        self.summary.stream(id).ok_or_else(|| {
            let known: Vec<&str> = self.summary.streams.iter().map(|stream| stream.description.id.as_str()).collect();
            ContainerError::UnknownStream { path: self.path.clone(), id: id.to_owned(), known: known.join(", ") }
        })
    }

    /// The messages in the order of the file, from the chunk on in which host time `from_host_ns` lies; `None` for all.
    /// What is older is left out.
    pub fn messages(&mut self, from_host_ns: Option<i64>) -> Messages<'_, R> {
        match self.window {
            None => self.messages_within(from_host_ns, i64::MAX),
            Some([from, to]) => self.messages_within(Some(from_host_ns.map_or(from, |asked| asked.max(from))), to),
        }
    }

    /// Restricts [`Session::messages`] and [`Session::decode_events`] to what arrived within these host times, the last one
    /// included; `None` lifts that.
    pub fn restrict(&mut self, window_host_ns: Option<[i64; 2]>) {
        self.window = window_host_ns;
    }

    /// What readers are restricted to.
    pub(super) fn window(&self) -> Option<[i64; 2]> {
        self.window
    }

    pub(super) fn messages_within(&mut self, from_host_ns: Option<i64>, to_ns: i64) -> Messages<'_, R> {
        let first = mcap::MAGIC.len() as u64;
        let offset = from_host_ns.map_or(first, |from| {
            let from = self.summary.start.log_time(from);
            let chunk = self.chunks.iter().find(|chunk| chunk.end >= from);
            chunk.or(self.chunks.last()).map_or(first, |chunk| chunk.offset)
        });
        self.walk.go_to(offset);
        let streams = self.summary.streams.len();
        let range = Range { streams, from_ns: from_host_ns.unwrap_or(i64::MIN), to_ns, over: false };
        Messages { walk: &mut self.walk, range }
    }

    /// As [`Session::messages`], with the session kept in what gives them.
    #[must_use]
    pub fn into_messages(mut self, from_host_ns: Option<i64>) -> IntoMessages<R> {
        let Messages { range, .. } = self.messages(from_host_ns);
        IntoMessages { walk: self.walk, range }
    }

    /// Whether the whole file was read when it was opened, as its end did not say what it holds: what is damaged is known
    /// then.
    #[must_use]
    pub fn was_read_through(&self) -> bool {
        !self.indexed
    }

    /// Reads everything, and verifies the checksums: one message for each place that is damaged, and one if the packets are
    /// others than the end of the file says. `progress` is called with the bytes of packets so far.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn check(&mut self, mut progress: impl FnMut(u64)) -> Result<Vec<String>, ContainerError> {
        let (mut damage, mut bytes) = (Vec::new(), 0);
        for entry in self.messages(None) {
            match entry {
                Ok(Entry::Packet { packet, .. }) => {
                    bytes += packet.payload.len() as u64;
                    progress(bytes);
                }
                Ok(_) => {}
                Err(error @ ContainerError::Damaged { .. }) => damage.push(error.to_string()),
                Err(error) => return Err(error),
            }
        }
        if self.window.is_none() {
            damage.extend(self.lacking());
        }
        Ok(damage)
    }

    /// What lacks in the file, all of which was just read.
    fn lacking(&self) -> Vec<String> {
        let totals = self.end_totals.as_ref().filter(|totals| self.summary.is_session && self.know(totals));
        self.walk.lacking(self.summary.is_session, totals, self.index.counts.as_ref())
    }

    /// Gives the file back.
    pub fn into_inner(self) -> R {
        self.walk.framing.into_inner()
    }

    /// Whether totals are of any of the streams that are here; otherwise all were given other names since.
    fn know(&self, totals: &Totals) -> bool {
        let declared = &self.walk.layout.streams;
        declared.is_empty() || declared.iter().any(|stream| totals.streams.contains_key(&stream.description.id))
    }

    /// Reads what the end of the file says. `false` if it says nothing, or not enough.
    fn read_index(&mut self) -> Result<bool, ContainerError> {
        let Some(summary_start) = self.walk.framing.summary_start()? else { return Ok(false) };
        let mut totals_found = false;
        self.walk.go_to(summary_start);
        loop {
            let head = match self.walk.step() {
                Ok(Item::Record(head)) => head,
                Ok(Item::End { .. }) => break,
                Ok(_) => return Ok(false),
                Err(error @ ContainerError::Read { .. }) => return Err(error),
                Err(_) => return Ok(false),
            };
            let body = self.walk.framing.body(&head)?;
            match parse_record(head.opcode, &body) {
                // Either a chunk is compressed so, which reading through tells, or the index is damaged.
                Ok(Record::ChunkIndex(chunk)) if Compression::named(&chunk.compression).is_none() => return Ok(false),
                Ok(Record::ChunkIndex(chunk)) => {
                    self.chunks.push(ChunkAt { offset: chunk.chunk_start_offset, end: chunk.message_end_time });
                }
                Ok(Record::MetadataIndex(index)) => {
                    let Some(head) = self.walk.framing.head_at(index.offset, op::METADATA)? else { return Ok(false) };
                    totals_found |= index.name == TOTALS_METADATA;
                    self.note(&head)?;
                }
                Ok(Record::AttachmentIndex(index)) => {
                    let Some(head) = self.walk.framing.head_at(index.offset, op::ATTACHMENT)? else { return Ok(false) };
                    self.note(&head)?;
                }
                Ok(_) => {}
                Err(_) => return Ok(false),
            }
        }
        for stream in &mut self.walk.layout.streams {
            if let Some(totals) = self.summary.totals.streams.get(&stream.description.id) {
                stream.totals = *totals;
            }
        }
        let ordered = self.chunks.windows(2).all(|pair| pair[0].offset < pair[1].offset);
        self.summary.complete = true;
        self.summary.chunks = self.chunks.len();
        self.summary.whole_bytes = summary_start;
        // The streams of a ROS 2 recording are known from their packets alone, also in a repaired copy, which has totals.
        Ok(totals_found && ordered && self.summary.is_session && self.know(&self.summary.totals))
    }

    /// Reads the file through.
    fn scan(&mut self) -> Result<(), ContainerError> {
        self.chunks.clear();
        self.end_totals = None;
        self.summary = Summary { file_bytes: self.walk.framing.length(), ..Summary::default() };
        self.walk.layout = Layout::default();
        self.walk.layout.spare = self.index.declared.clone();
        self.walk.go_to(mcap::MAGIC.len() as u64);
        loop {
            match self.walk.step() {
                Ok(Item::Chunk(head, header)) => {
                    self.chunks.push(ChunkAt { offset: head.offset, end: header.message_end_time });
                }
                Ok(Item::BadChunk(_, error @ ContainerError::Compression { .. })) => return Err(error),
                Ok(Item::BadChunk(_, error) | Item::Mended(error, _)) => self.summary.damage.push(error.to_string()),
                Ok(Item::Entry(entry)) => self.walk.layout.count(entry, &mut self.summary.totals),
                Ok(Item::Raw(_) | Item::ChunkEnd(_)) => {}
                Ok(Item::Record(head)) => self.note(&head)?,
                Ok(Item::End { at, closed }) => {
                    self.summary.complete = closed;
                    self.summary.whole_bytes = at;
                    break;
                }
                Err(error @ ContainerError::Read { .. }) => return Err(error),
                Err(error) => self.summary.damage.push(error.to_string()),
            }
        }
        self.summary.chunks = self.chunks.len();
        Ok(())
    }

    /// Takes note of metadata and attachments.
    fn note(&mut self, head: &Head) -> Result<(), ContainerError> {
        if !matches!(head.opcode, op::METADATA | op::ATTACHMENT) {
            return Ok(());
        }
        let body = self.walk.framing.body(head)?;
        let damaged = |what: String| ContainerError::Damaged { path: self.path.clone(), offset: head.offset, what };
        let summary = &mut self.summary;
        match parse_record(head.opcode, &body).map_err(damaged) {
            Ok(Record::Metadata(record)) if record.name == SESSION_METADATA => {
                let version = record.metadata.get("version").cloned().unwrap_or_default();
                if version.parse::<u32>().is_ok_and(|version| version > VERSION) {
                    return Err(ContainerError::Version { path: self.path.clone(), version, known: VERSION });
                }
                match SessionStart::from_metadata(&record.metadata) {
                    Some(start) => (summary.start, summary.is_session) = (start, true),
                    None => summary.damage.push(damaged("the start of the session is incomplete".into()).to_string()),
                }
            }
            Ok(Record::Metadata(record)) if record.name == TOTALS_METADATA => {
                match Totals::from_metadata(&record.metadata) {
                    // What was counted while the file was read through stands, and is compared.
                    Ok(totals) => {
                        if summary.totals == Totals::default() {
                            summary.totals.clone_from(&totals);
                        }
                        self.end_totals = Some(totals);
                    }
                    Err(error) => summary.damage.push(damaged(error.to_string()).to_string()),
                }
            }
            Ok(Record::Attachment { header, data, .. }) if header.name == RIG_ATTACHMENT => {
                summary.rig = Some(String::from_utf8_lossy(&data).into_owned());
            }
            Ok(_) => {}
            Err(error) => summary.damage.push(error.to_string()),
        }
        Ok(())
    }

    fn complete_summary(&mut self) -> Result<(), ContainerError> {
        let summary = &mut self.summary;
        summary.streams.clone_from(&self.walk.layout.streams);
        summary.unknown_encodings.clone_from(&self.walk.layout.unknown_encodings);
        for stream in &summary.streams {
            summary.totals.streams.insert(stream.description.id.clone(), stream.totals);
        }
        if summary.is_session {
            return Ok(());
        }
        if !self.walk.layout.is_known() {
            let what = "it has neither the start of a session nor packets of events of ROS 2 \
                        (event_camera_msgs/msg/EventPacket); if it is the beginning of a session, too little of it is left";
            return Err(ContainerError::NotASession { path: self.path.clone(), what });
        }
        // ROS 2 stamps with the time since 1970, which serves as host time.
        let first = summary.span_ns().map_or(0, |[first, _]| first);
        summary.start = SessionStart { host_ns: first, epoch_ns: first, program: "ROS 2".into(), ..Default::default() };
        Ok(())
    }
}
