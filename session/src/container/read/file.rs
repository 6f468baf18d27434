//! One file of a session, as it is known since it was opened: what its end says of it, or what was found by reading it through.

use std::{
    io::{Read, Seek},
    path::{Path, PathBuf},
};

use mcap::records::{Record, op};

use super::{
    framing::Head,
    index::Index,
    layout::Layout,
    parse::parse_record,
    unpack::Compression,
    walk::{Item, Walk},
};
use crate::container::{
    ContainerError, PartOf, Summary,
    parts::PART_METADATA,
    record::{RIG_ATTACHMENT, SESSION_METADATA, SessionStart, TOTALS_METADATA, Totals, VERSION},
};

/// Where a chunk lies, and the log time of its last message.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkAt {
    pub offset: u64,
    pub end: u64,
}

/// See the module. The walk over the file knows its channels, except while another file is walked over.
#[derive(Debug, Default)]
pub(super) struct SessionFile {
    pub path: PathBuf,
    pub summary: Summary,
    pub chunks: Vec<ChunkAt>,
    /// Whether the index at the end said what there is.
    pub indexed: bool,
    /// What the end of the file says, if it was closed; of a session also the totals.
    index: Index,
    end_totals: Option<Totals>,
    /// The channels, while another file is walked over.
    pub layout: Layout,
    /// Which stream of the session each stream of the file is.
    pub streams: Vec<usize>,
}

impl SessionFile {
    /// Finds out what the file holds that `walk` goes over.
    pub fn read<R: Read + Seek>(walk: &mut Walk<R>, path: &Path) -> Result<Self, ContainerError> {
        let summary = Summary { file_bytes: walk.framing.length(), ..Summary::default() };
        let mut file = Self { path: path.to_owned(), summary, ..Self::default() };
        file.indexed = file.read_index(walk)?;
        if file.indexed {
            file.end_totals = Some(file.summary.totals.clone());
        } else {
            file.scan(walk)?;
            if file.summary.complete {
                file.index = walk.framing.index_behind(file.summary.whole_bytes)?;
            }
            // What is damaged or lacks may have declared streams, which the index does, too.
            let in_doubt = !file.summary.damage.is_empty() || !walk.layout.is_known();
            if in_doubt && !file.index.declared.channels.is_empty() {
                file.scan(walk)?;
            }
            // What is damaged lacks, of course.
            if file.summary.damage.is_empty() {
                file.summary.damage = file.lacking(walk);
            }
        }
        file.complete_summary(walk)?;
        file.streams = (0..file.summary.streams.len()).collect();
        Ok(file)
    }

    /// What lacks in the file, all of which `walk` has just read.
    pub fn lacking<R>(&self, walk: &Walk<R>) -> Vec<String> {
        let is_session = self.summary.is_session;
        let totals = self.end_totals.as_ref().filter(|totals| is_session && know(&walk.layout, totals));
        walk.lacking(is_session, totals, self.index.counts.as_ref())
    }

    /// Reads what the end of the file says. `false` if it says nothing, or not enough.
    fn read_index<R: Read + Seek>(&mut self, walk: &mut Walk<R>) -> Result<bool, ContainerError> {
        let Some(summary_start) = walk.framing.summary_start()? else { return Ok(false) };
        let mut totals_found = false;
        walk.go_to(summary_start);
        loop {
            let head = match walk.step() {
                Ok(Item::Record(head)) => head,
                Ok(Item::End { .. }) => break,
                Ok(_) => return Ok(false),
                Err(error @ ContainerError::Read { .. }) => return Err(error),
                Err(_) => return Ok(false),
            };
            let body = walk.framing.body(&head)?;
            match parse_record(head.opcode, &body) {
                // Either a chunk is compressed so, which reading through tells, or the index is damaged.
                Ok(Record::ChunkIndex(chunk)) if Compression::named(&chunk.compression).is_none() => return Ok(false),
                Ok(Record::ChunkIndex(chunk)) => {
                    self.chunks.push(ChunkAt { offset: chunk.chunk_start_offset, end: chunk.message_end_time });
                }
                Ok(Record::MetadataIndex(index)) => {
                    let Some(head) = walk.framing.head_at(index.offset, op::METADATA)? else { return Ok(false) };
                    totals_found |= index.name == TOTALS_METADATA;
                    self.note(walk, &head)?;
                }
                Ok(Record::AttachmentIndex(index)) => {
                    let Some(head) = walk.framing.head_at(index.offset, op::ATTACHMENT)? else { return Ok(false) };
                    self.note(walk, &head)?;
                }
                Ok(_) => {}
                Err(_) => return Ok(false),
            }
        }
        for stream in &mut walk.layout.streams {
            if let Some(totals) = self.summary.totals.streams.get(&stream.description.id) {
                stream.totals = *totals;
            }
        }
        let ordered = self.chunks.windows(2).all(|pair| pair[0].offset < pair[1].offset);
        self.summary.complete = true;
        self.summary.chunks = self.chunks.len();
        self.summary.whole_bytes = summary_start;
        // The streams of a ROS 2 recording are known from their packets alone, also in a repaired copy, which has totals.
        Ok(totals_found && ordered && self.summary.is_session && know(&walk.layout, &self.summary.totals))
    }

    /// Reads the file through.
    fn scan<R: Read + Seek>(&mut self, walk: &mut Walk<R>) -> Result<(), ContainerError> {
        self.chunks.clear();
        self.end_totals = None;
        self.summary = Summary { file_bytes: walk.framing.length(), ..Summary::default() };
        walk.layout = Layout::default();
        walk.layout.spare = self.index.declared.clone();
        walk.go_to(mcap::MAGIC.len() as u64);
        loop {
            match walk.step() {
                Ok(Item::Chunk(head, header)) => {
                    self.chunks.push(ChunkAt { offset: head.offset, end: header.message_end_time });
                }
                Ok(Item::BadChunk(_, error @ ContainerError::Compression { .. })) => return Err(error),
                Ok(Item::BadChunk(_, error) | Item::Mended(error, _)) => self.summary.damage.push(error.to_string()),
                Ok(Item::Entry(entry)) => walk.layout.count(entry, &mut self.summary.totals),
                Ok(Item::Raw(_) | Item::ChunkEnd(_)) => {}
                Ok(Item::Record(head)) => self.note(walk, &head)?,
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
    fn note<R: Read + Seek>(&mut self, walk: &mut Walk<R>, head: &Head) -> Result<(), ContainerError> {
        if !matches!(head.opcode, op::METADATA | op::ATTACHMENT) {
            return Ok(());
        }
        let body = walk.framing.body(head)?;
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
            Ok(Record::Metadata(record)) if record.name == PART_METADATA => {
                summary.part = PartOf::from_metadata(&record.metadata);
                if summary.part.is_none() {
                    let what = "what it says of the part that it is does not parse".to_owned();
                    summary.damage.push(damaged(what).to_string());
                }
            }
            Ok(Record::Metadata(record)) if record.name == TOTALS_METADATA => {
                match Totals::from_metadata(&record.metadata) {
                    // What was counted while the file was read through stands, and is compared.
                    Ok(totals) => {
                        if summary.totals == Totals::default() {
                            summary.totals.clone_from(&totals);
                        }
                        summary.totals.continues = totals.continues;
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

    fn complete_summary<R>(&mut self, walk: &Walk<R>) -> Result<(), ContainerError> {
        let summary = &mut self.summary;
        summary.streams.clone_from(&walk.layout.streams);
        summary.unknown_encodings.clone_from(&walk.layout.unknown_encodings);
        for stream in &summary.streams {
            summary.totals.streams.insert(stream.description.id.clone(), stream.totals);
        }
        if summary.is_session {
            return Ok(());
        }
        if !walk.layout.is_known() {
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

/// Whether totals are of any of the streams that are here; otherwise all were given other names since.
fn know(layout: &Layout, totals: &Totals) -> bool {
    let declared = &layout.streams;
    declared.is_empty() || declared.iter().any(|stream| totals.streams.contains_key(&stream.description.id))
}
