//! Everything in a session file, in the order in which it lies there, with one chunk in memory at a time.

use std::{
    borrow::Cow,
    io::{Read, Seek},
    path::Path,
};

use bytes::Bytes;
use mcap::records::{ChunkHeader, Record, op};

use super::{
    chunk::{RawMessage, take_record},
    error::ContainerError,
    framing::{Framing, Head},
    layout::{Entry, Layout, Meaning},
    parse::parse_record,
    unpack::Compression,
};

/// What a walk meets.
pub(super) enum Item {
    /// A chunk; its messages follow.
    Chunk(Head, ChunkHeader),
    /// A chunk that is broken as a whole. None of its messages follow.
    BadChunk(Head, ContainerError),
    /// A message that erfgs reads.
    Entry(Entry),
    /// A message, before it is read; only if [`Walk::raw`] is set.
    Raw(RawMessage),
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
pub(super) struct Walk<R> {
    pub framing: Framing<R>,
    pub layout: Layout,
    /// Whether messages are also handed over as they lie in the file, before what they say.
    pub raw: bool,
    /// What is left of the chunk, how long it was, and where the chunk starts.
    content: Bytes,
    content_length: usize,
    chunk: u64,
    pending: Option<Entry>,
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
            content: Bytes::new(),
            content_length: 0,
            chunk: 0,
            pending: None,
            next,
            over: false,
        })
    }

    /// Goes to a record outside the chunks.
    pub fn go_to(&mut self, offset: u64) {
        (self.next, self.over, self.pending) = (offset, false, None);
        self.content.clear();
    }

    /// Where the chunk starts that was read last.
    pub fn chunk_offset(&self) -> u64 {
        self.chunk
    }

    /// What comes next. After an error that concerns a chunk or a message, the walk goes on behind it.
    pub fn step(&mut self) -> Result<Item, ContainerError> {
        if let Some(entry) = self.pending.take() {
            return Ok(Item::Entry(entry));
        }
        loop {
            if self.content.is_empty() {
                if let Some(item) = self.outside()? {
                    return Ok(item);
                }
            } else {
                let offset = self.content_length - self.content.len();
                let Some((opcode, body)) = take_record(&mut self.content) else {
                    self.content.clear();
                    return Err(self.damaged(self.chunk, "a record in it is longer than the chunk"));
                };
                if let Some(item) = self.inside(opcode, body, self.chunk, Some(offset))? {
                    return Ok(item);
                }
            }
        }
    }

    /// The next record of the file itself.
    fn outside(&mut self) -> Result<Option<Item>, ContainerError> {
        if self.over {
            return Ok(Some(Item::End { at: self.next, closed: false }));
        }
        self.framing.go_to(self.next)?;
        let Some(head) = self.framing.head()? else {
            self.over = true;
            return Ok(Some(Item::End { at: self.next, closed: false }));
        };
        if head.opcode == op::DATA_END || head.opcode == op::FOOTER {
            self.over = true;
            let closed = self.is_closed()?;
            return Ok(Some(Item::End { at: head.offset, closed }));
        }
        self.next = head.end();
        match head.opcode {
            op::CHUNK => self.chunk(head).map(Some),
            op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                let body = self.framing.body(&head)?;
                let item = self.inside(head.opcode, body, head.offset, None)?;
                Ok(item.or((head.opcode != op::MESSAGE).then_some(Item::Record(head))))
            }
            _ => Ok(Some(Item::Record(head))),
        }
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
        match self.verified_chunk(&head) {
            Ok((header, content)) => {
                (self.content_length, self.content, self.chunk) = (content.len(), content, head.offset);
                Ok(Item::Chunk(head, header))
            }
            Err(error @ ContainerError::Read { .. }) => Err(error),
            Err(error) => Ok(Item::BadChunk(head, error)),
        }
    }

    /// A chunk's header, and its records as they are when they are unpacked.
    fn verified_chunk(&mut self, head: &Head) -> Result<(ChunkHeader, Bytes), ContainerError> {
        let body = self.framing.body(head)?;
        let damaged = |what: String| self.damaged(head.offset, &what);
        let Record::Chunk { header, data: Cow::Borrowed(packed) } = parse_record(op::CHUNK, &body).map_err(damaged)?
        else {
            return Err(self.damaged(head.offset, "its header is no chunk's"));
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
        if opcode != op::MESSAGE {
            if opcode == op::SCHEMA || opcode == op::CHANNEL {
                self.layout.learn(opcode, &body).map_err(|what| self.damaged(at, &what))?;
            }
            return Ok(None);
        }
        let message = RawMessage::parse(body, offset).ok_or_else(|| self.damaged(at, "a message is too short"))?;
        let entry = match self.layout.read(&message) {
            Meaning::Entry(entry) => Some(entry),
            Meaning::Foreign => None,
            Meaning::Broken(what) => return Err(self.damaged(at, &what)),
        };
        if self.raw {
            self.pending = entry;
            return Ok(Some(Item::Raw(message)));
        }
        Ok(entry.map(Item::Entry))
    }

    fn damaged(&self, offset: u64, what: &str) -> ContainerError {
        ContainerError::Damaged { path: self.framing.path().to_owned(), offset, what: what.to_owned() }
    }
}

/// Length of the footer's record and the closing magic.
pub(super) const FOOTER_BYTES: u64 = 9 + 20 + 8;
