//! Everything in a session file, in the order in which it lies there, with one chunk in memory at a time.

use std::{
    borrow::Cow,
    collections::{BTreeMap, HashMap},
    io::{Read, Seek},
    ops::Range,
    path::Path,
};

use bytes::Bytes;
use mcap::records::{ChunkHeader, Record, op};

use super::{
    chunk::{RawMessage, next_message, take_record},
    framing::{Framing, Head},
    layout::{Layout, Meaning},
    packet_log::PacketLog,
    parse::parse_record,
    resync::Mended,
    unpack::Compression,
};
use crate::container::{ContainerError, Entry};

/// What a walk meets.
pub(in crate::container) enum Item {
    /// A chunk; its messages follow.
    Chunk(Head, ChunkHeader),
    /// A chunk that is broken as a whole, or a part of the file in which no record can be found: from where to where. None of
    /// its messages follow.
    BadChunk([u64; 2], ContainerError),
    /// The chunk that follows was damaged, and is handed over as it was before. What is wrong, and the bytes of the file that
    /// were others.
    Mended(ContainerError, Vec<(u64, u8)>),
    /// A message that erfgs reads.
    Entry(Entry),
    /// A message, before it is read; only if [`Walk::raw`] is set.
    Raw(RawMessage),
    /// The chunk is over: where the records lie in its content that are whole and did not come before; only if [`Walk::raw`]
    /// is set.
    ChunkEnd(Vec<Range<usize>>),
    /// A record outside the chunks that is no message, for those who need its body.
    Record(Head),
    /// The data is over: the footer or the end of what is whole. Nothing follows.
    End {
        /// The byte after the last whole record.
        at: u64,
        /// Whether the file was closed as it should be.
        closed: bool,
    },
}

/// Walks over a file.
pub(in crate::container) struct Walk<R> {
    pub framing: Framing<R>,
    pub layout: Layout,
    /// Whether messages are also handed over as they lie in the file, before what they say.
    pub raw: bool,
    /// The whole records of the chunk, which is not over.
    kept: Option<Vec<Range<usize>>>,
    /// How many messages each channel had so far.
    pub counts: BTreeMap<u16, u64>,
    /// The packets of each stream so far.
    pub logs: Vec<PacketLog>,
    /// The chunks so far, by what tells one from another: where each lies.
    chunks: HashMap<([u64; 2], usize, u32), u64>,
    /// The packets of the chunk that came before: how many, and what they are.
    again: Option<(u64, String)>,
    /// What is left of the chunk, the whole, and where the chunk starts.
    content: Bytes,
    chunk_content: Bytes,
    chunk: u64,
    span: [u64; 2],
    pending: Option<Item>,
    at: u64,
    next: u64,
    over: bool,
}

impl<R: Read + Seek> Walk<R> {
    /// Stands at the first record of `file`.
    pub fn open(file: R, path: &Path) -> Result<Self, ContainerError> {
        let framing = Framing::open(file, path)?;
        let next = mcap::MAGIC.len() as u64;
        Ok(Self {
            framing,
            layout: Layout::default(),
            raw: false,
            kept: None,
            counts: BTreeMap::new(),
            logs: Vec::new(),
            chunks: HashMap::new(),
            again: None,
            content: Bytes::new(),
            chunk_content: Bytes::new(),
            chunk: 0,
            span: [0, 0],
            pending: None,
            at: next,
            next,
            over: false,
        })
    }

    /// Goes to a record outside the chunks, from which on packets and messages are counted.
    pub fn go_to(&mut self, offset: u64) {
        (self.next, self.over, self.pending, self.again) = (offset, false, None, None);
        (self.content, self.kept) = (Bytes::new(), None);
        self.framing.begin_pass();
        self.logs.clear();
        self.chunks.clear();
        self.counts.clear();
    }

    /// Where the record outside the chunks lies that was read last.
    pub fn last_record(&self) -> [u64; 2] {
        [self.at, self.next]
    }

    /// Where the chunk starts that was read last.
    pub fn chunk_offset(&self) -> u64 {
        self.chunk
    }

    /// The records of the chunk that was read last.
    pub fn chunk_content(&self) -> &Bytes {
        &self.chunk_content
    }

    /// What comes next. After an error that concerns a chunk or a message, the walk goes on behind it.
    pub fn step(&mut self) -> Result<Item, ContainerError> {
        if let Some(item) = self.pending.take() {
            return Ok(item);
        }
        loop {
            if !self.content.is_empty() {
                let offset = self.chunk_content.len() - self.content.len();
                let record = take_record(&mut self.content).filter(|(opcode, _)| is_of_chunk(*opcode));
                let Some((opcode, body)) = record else {
                    return Err(self.broken_chunk(offset));
                };
                if let Some(item) = self.inside(opcode, body, self.chunk, Some(offset))? {
                    return Ok(item);
                }
            } else if let Some((count, first)) = self.again.take() {
                let what =
                    format!("{count} packets in it are duplicates, the first is {first}; duplicates are skipped");
                return Err(self.damaged(self.chunk, &what));
            } else if let Some(kept) = self.kept.take() {
                return Ok(Item::ChunkEnd(kept));
            } else if let Some(item) = self.outside()? {
                return Ok(item);
            }
        }
    }

    /// A record of the chunk, at `offset` of its content, is none. Goes on with the next message that can be one.
    fn broken_chunk(&mut self, offset: usize) -> ContainerError {
        let known = |channel| self.layout.knows(channel);
        let next = next_message(&self.chunk_content, offset + 1, self.span, known);
        self.content = next.map_or(Bytes::new(), |next| self.chunk_content.slice(next..));
        let lost = next.unwrap_or(self.chunk_content.len()) - offset;
        self.damaged(self.chunk, &format!("{lost} bytes in the chunk are no records"))
    }

    /// The next record of the file itself.
    fn outside(&mut self) -> Result<Option<Item>, ContainerError> {
        let at = self.next;
        self.at = at;
        if self.over {
            return Ok(Some(Item::End { at, closed: false }));
        }
        self.framing.go_to(at)?;
        let head = self.framing.head()?;
        if let Some(head) = head.filter(|head| head.opcode == op::CHUNK) {
            return self.chunk(head).map(Some);
        }
        if head.is_some_and(|head| matches!((head.opcode, head.length), (op::DATA_END, 4) | (op::FOOTER, 20))) {
            self.over = true;
            let closed = self.is_closed()?;
            return Ok(Some(Item::End { at, closed }));
        }
        if let Some(mended) = self.framing.mended(at)? {
            return Ok(Some(self.mended(mended)));
        }
        let Some(head) = head.filter(|head| head.opcode != op::DATA_END && head.opcode != op::FOOTER) else {
            let Some(next) = self.framing.next_chunk(at + 1)? else {
                self.over = true;
                return Ok(Some(Item::End { at, closed: false }));
            };
            return Ok(Some(self.gap(at, next)));
        };
        if !self.framing.is_plausible(head.end())?
            && let Some(next) = self.framing.next_chunk(at + 1)?
        {
            return Ok(Some(self.gap(at, next)));
        }
        self.next = head.end();
        match head.opcode {
            op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                let body = self.framing.body(&head)?;
                let item = self.inside(head.opcode, body, head.offset, None)?;
                Ok(item.or((head.opcode != op::MESSAGE).then_some(Item::Record(head))))
            }
            _ => Ok(Some(Item::Record(head))),
        }
    }

    /// From `at` to `next`, where the next chunk lies, there is nothing that can be read.
    fn gap(&mut self, at: u64, next: u64) -> Item {
        self.next = next;
        let what = format!("the {} bytes up to the next chunk are no records", next - at);
        Item::BadChunk([at, next], self.damaged(at, &what))
    }

    /// Whether a footer and the closing magic end the file.
    pub fn is_closed(&mut self) -> Result<bool, ContainerError> {
        let length = self.framing.length();
        match length.checked_sub(FOOTER_BYTES) {
            Some(footer) => {
                self.framing.go_to(footer)?;
                let head = self.framing.head()?;
                let whole = head.is_some_and(|head| head.opcode == op::FOOTER && head.length == 20);
                Ok(whole && self.framing.closed_at(length - mcap::MAGIC.len() as u64)?)
            }
            None => Ok(false),
        }
    }

    fn chunk(&mut self, head: Head) -> Result<Item, ContainerError> {
        self.next = head.end();
        match self.verified_chunk(&head) {
            Ok((header, content)) => {
                if let Some(before) = self.comes_again(head.offset, &header, &content) {
                    let what = format!("the chunk repeats that of byte {before}; it is skipped");
                    return Ok(Item::BadChunk([head.offset, head.end()], self.damaged(head.offset, &what)));
                }
                self.begin(head.offset, &header, content);
                Ok(Item::Chunk(head, header))
            }
            Err(error @ ContainerError::Read { .. }) => Err(error),
            Err(error) => {
                if let Some(mended) = self.framing.mended(head.offset)? {
                    return Ok(self.mended(mended));
                }
                if !self.framing.is_plausible(head.end())?
                    && let Some(next) = self.framing.next_chunk(head.offset + 1)?
                {
                    return Ok(self.gap(head.offset, next));
                }
                Ok(Item::BadChunk([head.offset, head.end()], error))
            }
        }
    }

    /// Where the same chunk lies, if there was one with messages.
    fn comes_again(&mut self, offset: u64, header: &ChunkHeader, content: &Bytes) -> Option<u64> {
        if header.message_end_time == 0 || content.is_empty() {
            return None;
        }
        let checksum = if header.uncompressed_crc != 0 { header.uncompressed_crc } else { crc32fast::hash(content) };
        let times = [header.message_start_time, header.message_end_time];
        let before = *self.chunks.entry((times, content.len(), checksum)).or_insert(offset);
        (before != offset).then_some(before)
    }

    fn begin(&mut self, offset: u64, header: &ChunkHeader, content: Bytes) {
        (self.content, self.chunk_content, self.chunk) = (content.clone(), content, offset);
        self.span = [header.message_start_time, header.message_end_time];
        self.kept = self.raw.then(Vec::new);
    }

    /// A chunk that was damaged, as it was before.
    fn mended(&mut self, mended: Mended) -> Item {
        let Mended { head, header, content, what, patches } = mended;
        self.next = head.end();
        let error = self.damaged(head.offset, &what);
        self.begin(head.offset, &header, content);
        self.pending = Some(Item::Chunk(head, header));
        Item::Mended(error, patches)
    }

    /// A chunk's header, and its records as they are when they are unpacked.
    fn verified_chunk(&mut self, head: &Head) -> Result<(ChunkHeader, Bytes), ContainerError> {
        let body = self.framing.body(head)?;
        let damaged = |what: String| self.damaged(head.offset, &what);
        let Record::Chunk { header, data: Cow::Borrowed(packed) } = parse_record(op::CHUNK, &body).map_err(damaged)?
        else {
            return Err(self.damaged(head.offset, "its header is not that of a chunk"));
        };
        let Some(compression) = Compression::named(&header.compression) else {
            return Err(ContainerError::Compression {
                path: self.framing.path().to_owned(),
                offset: head.offset,
                compression: header.compression.chars().take(40).collect(),
            });
        };
        let content = compression.unpack(body.slice_ref(packed), header.uncompressed_size).map_err(damaged)?;
        if header.uncompressed_crc != 0 && crc32fast::hash(&content) != header.uncompressed_crc {
            return Err(self.damaged(head.offset, "the content of the chunk does not match its checksum"));
        }
        Ok((header, content))
    }

    /// A record of a chunk, at `offset` of its content, or one that could be and lies outside.
    fn inside(
        &mut self,
        opcode: u8,
        body: Bytes,
        at: u64,
        offset: Option<usize>,
    ) -> Result<Option<Item>, ContainerError> {
        let range = |body: &Bytes| offset.map(|offset| offset..offset + 9 + body.len());
        let place = range(&body);
        if opcode != op::MESSAGE {
            if opcode == op::SCHEMA || opcode == op::CHANNEL {
                self.layout.learn(opcode, &body).map_err(|what| self.damaged(at, &what))?;
            }
            self.keep(place);
            return Ok(None);
        }
        let message = RawMessage::parse(body, offset).ok_or_else(|| self.damaged(at, "a message is too short"))?;
        *self.counts.entry(message.channel).or_default() += 1;
        let entry = match self.layout.read(&message) {
            Meaning::Entry(Entry::Packet { stream, packet }) => {
                if self.logs.len() <= stream {
                    self.logs.resize_with(stream + 1, PacketLog::default);
                }
                if !self.logs[stream].take(&packet) {
                    let id = &self.layout.streams[stream].description.id;
                    let first = || format!("packet {} of stream '{id}'", packet.sequence);
                    self.again.get_or_insert_with(|| (0, first())).0 += 1;
                    return Ok(None);
                }
                Some(Entry::Packet { stream, packet })
            }
            Meaning::Entry(entry) => Some(entry),
            Meaning::Foreign => None,
            Meaning::Broken(what) => return Err(self.damaged(at, &what)),
        };
        self.keep(place);
        if self.raw {
            self.pending = entry.map(Item::Entry);
            return Ok(Some(Item::Raw(message)));
        }
        Ok(entry.map(Item::Entry))
    }

    fn keep(&mut self, place: Option<Range<usize>>) {
        if let (Some(kept), Some(place)) = (&mut self.kept, place) {
            kept.push(place);
        }
    }

    fn damaged(&self, offset: u64, what: &str) -> ContainerError {
        ContainerError::Damaged { path: self.framing.path().to_owned(), offset, what: what.to_owned() }
    }
}

/// Whether a record of this kind may lie in a chunk. Kinds from 0x80 on are for programs of their own.
fn is_of_chunk(opcode: u8) -> bool {
    matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE | 0x80..)
}

/// Length of the footer's record and the closing magic.
pub(super) const FOOTER_BYTES: u64 = 9 + 20 + 8;
