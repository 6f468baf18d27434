//! The end of a session file: the index of the last chunk, the totals, the index of the file.

use std::collections::BTreeMap;

use bytes::{BufMut, Bytes};
use mcap::records::{ChunkHeader, Record, op};

use crate::container::{
    read::{Declarations, Head, RawMessage, parse_record},
    record::TOTALS_METADATA,
};

/// Text by name, as metadata holds it.
type Texts = BTreeMap<String, String>;

/// Messages by channel: log time and offset in the chunk.
type ByChannel = BTreeMap<u16, Vec<(u64, u64)>>;

/// A chunk for the index.
#[derive(Debug)]
pub(super) struct ChunkEntry {
    offset: u64,
    length: u64,
    header: ChunkHeader,
    /// Its messages.
    messages: ByChannel,
    /// Where the index of each channel lies, and how long they are together.
    indexes: BTreeMap<u16, u64>,
    index_bytes: u64,
}

impl ChunkEntry {
    pub fn new(offset: u64, length: u64, header: ChunkHeader) -> Self {
        Self { offset, length, header, messages: BTreeMap::new(), indexes: BTreeMap::new(), index_bytes: 0 }
    }

    /// Whether a channel with messages in the chunk has no index. Those of chunks before the last, and of one that was written
    /// anew, are forgotten.
    fn lacks_indexes(&self) -> bool {
        self.messages.keys().any(|channel| !self.indexes.contains_key(channel))
    }
}

/// A chunk of `records` alone, not compressed, and the index of its messages: the bytes for `offset` of a file, and the entry
/// for the file's index. `None` without a record.
pub(super) fn chunk_of(records: &[Bytes], offset: u64) -> Option<(Vec<u8>, ChunkEntry)> {
    let content = records.concat();
    let mut messages = ByChannel::new();
    let mut at = 0;
    for record in records {
        if record.first() == Some(&op::MESSAGE) && record.len() > 9 {
            let message = RawMessage::parse(record.slice(9..), Some(at))?;
            messages.entry(message.channel).or_default().push((message.log_time, at as u64));
        }
        at += record.len();
    }
    let times = || messages.values().flatten().map(|&(time, _)| time);
    let (start, end) = (times().min().unwrap_or(0), times().max().unwrap_or(0));
    let length = Some(content.len() as u64).filter(|&length| length > 0)?;
    let header = ChunkHeader {
        message_start_time: start,
        message_end_time: end,
        uncompressed_size: length,
        uncompressed_crc: crc32fast::hash(&content),
        compression: String::new(),
        compressed_size: length,
    };
    let mut body = Vec::with_capacity(content.len() + 40);
    for number in [start, end, length] {
        body.put_u64_le(number);
    }
    body.put_u32_le(header.uncompressed_crc);
    put_text(&mut body, "");
    body.put_u64_le(length);
    body.extend_from_slice(&content);
    let mut bytes = Vec::with_capacity(body.len() + 4096);
    put_record(&mut bytes, op::CHUNK, &body);
    let mut entry = ChunkEntry::new(offset, bytes.len() as u64, header);
    let chunk_bytes = bytes.len() as u64;
    entry.indexes = put_indexes(&mut bytes, &messages, offset);
    entry.index_bytes = bytes.len() as u64 - chunk_bytes;
    Some((bytes, entry))
}

/// What the end of a file says of it.
#[derive(Debug, Default)]
pub(super) struct Tail {
    chunks: Vec<ChunkEntry>,
    /// Totals to write, where the file has none.
    pub totals: Option<BTreeMap<String, String>>,
    /// All schemas and channels.
    pub declared: Declarations,
    /// Offset, length and name.
    metadata: Vec<(u64, u64, String)>,
    /// Bodies of the index records of attachments.
    attachments: Vec<Vec<u8>>,
    counts: BTreeMap<u16, u64>,
    span: Option<[u64; 2]>,
    /// Something that is no index follows the last chunk.
    more_after_chunk: bool,
}

impl Tail {
    /// Takes note of a chunk, the messages of which follow.
    pub fn begin(&mut self, chunk: ChunkEntry) {
        if let Some(before) = self.chunks.last_mut() {
            // Only the last chunk may need to have its messages indexed.
            before.messages.clear();
        }
        self.chunks.push(chunk);
        self.more_after_chunk = false;
    }

    /// Takes another chunk for the last one, or none.
    pub fn replace_last(&mut self, chunk: Option<ChunkEntry>) {
        self.chunks.pop();
        self.chunks.extend(chunk);
    }

    /// Takes note of a message of the last chunk, or of one that lies outside the chunks and needs no index.
    pub fn count(&mut self, message: &RawMessage) {
        *self.counts.entry(message.channel).or_default() += 1;
        let [start, end] = self.span.unwrap_or([message.log_time; 2]);
        self.span = Some([start.min(message.log_time), end.max(message.log_time)]);
        match (message.offset, self.chunks.last_mut()) {
            (Some(offset), Some(chunk)) => {
                chunk.messages.entry(message.channel).or_default().push((message.log_time, offset));
            }
            _ => self.more_after_chunk = true,
        }
    }

    /// The end of the last chunk, if its index is not complete and must be written anew, and nothing but index follows.
    pub fn unindexed_chunk_end(&self) -> Option<u64> {
        let last = self.chunks.last().filter(|_| !self.more_after_chunk);
        last.filter(|chunk| chunk.lacks_indexes()).map(|chunk| chunk.offset + chunk.length)
    }

    /// Takes note of a record outside the chunks, which moves by `shift` bytes.
    pub fn note(&mut self, head: &Head, body: &[u8], shift: i64) {
        let offset = head.offset.saturating_add_signed(shift);
        let length = head.end() - head.offset;
        match parse_record(head.opcode, body) {
            Ok(Record::MessageIndex(index)) => {
                if let Some(chunk) = self.chunks.last_mut() {
                    chunk.indexes.insert(index.channel_id, offset);
                    chunk.index_bytes += length;
                }
            }
            Ok(Record::Metadata(record)) => {
                self.metadata.push((offset, length, record.name));
                self.more_after_chunk = true;
            }
            Ok(Record::Attachment { header, data, .. }) => {
                self.more_after_chunk = true;
                let mut body = Vec::new();
                body.put_u64_le(offset);
                body.put_u64_le(length);
                body.put_u64_le(header.log_time);
                body.put_u64_le(header.create_time);
                body.put_u64_le(data.len() as u64);
                put_text(&mut body, &header.name);
                put_text(&mut body, &header.media_type);
                self.attachments.push(body);
            }
            _ if head.opcode == op::MESSAGE_INDEX => {}
            // A declaration, or what others may read.
            _ => self.more_after_chunk = true,
        }
    }

    /// Whether the file has a metadata record of this name.
    pub fn has_metadata(&self, name: &str) -> bool {
        self.metadata.iter().any(|(_, _, found)| found == name)
    }

    /// What follows the data, which is `position` bytes long.
    pub fn into_bytes(mut self, position: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        if let Some(chunk) = self.chunks.last_mut().filter(|chunk| chunk.lacks_indexes()) {
            (chunk.indexes, chunk.index_bytes) = (BTreeMap::new(), 0);
            chunk.indexes = put_indexes(&mut bytes, &chunk.messages, position);
            chunk.index_bytes = bytes.len() as u64;
        }
        if let Some(totals) = self.totals.take() {
            let offset = position + bytes.len() as u64;
            let mut body = Vec::new();
            put_text(&mut body, TOTALS_METADATA);
            put_texts(&mut body, &totals);
            put_record(&mut bytes, op::METADATA, &body);
            self.metadata.push((offset, position + bytes.len() as u64 - offset, TOTALS_METADATA.to_owned()));
        }
        // The checksum of the data section: none.
        put_record(&mut bytes, op::DATA_END, &[0; 4]);
        let summary_start = bytes.len();
        self.put_summary(&mut bytes);
        let mut footer = Vec::new();
        footer.put_u8(op::FOOTER);
        footer.put_u64_le(20);
        footer.put_u64_le(position + summary_start as u64);
        footer.put_u64_le(0);
        let mut crc = crc32fast::Hasher::new();
        crc.update(&bytes[summary_start..]);
        crc.update(&footer);
        footer.put_u32_le(crc.finalize());
        bytes.extend_from_slice(&footer);
        bytes.extend_from_slice(mcap::MAGIC);
        bytes
    }

    fn put_summary(&self, bytes: &mut Vec<u8>) {
        put_declarations(bytes, &self.declared);
        put_record(bytes, op::STATISTICS, &self.statistics());
        for chunk in &self.chunks {
            let mut body = Vec::new();
            let header = &chunk.header;
            for number in [header.message_start_time, header.message_end_time, chunk.offset, chunk.length] {
                body.put_u64_le(number);
            }
            body.put_u32_le(10 * chunk.indexes.len() as u32);
            for (&channel, &offset) in &chunk.indexes {
                body.put_u16_le(channel);
                body.put_u64_le(offset);
            }
            body.put_u64_le(chunk.index_bytes);
            put_text(&mut body, &header.compression);
            body.put_u64_le(header.compressed_size);
            body.put_u64_le(header.uncompressed_size);
            put_record(bytes, op::CHUNK_INDEX, &body);
        }
        for body in &self.attachments {
            put_record(bytes, op::ATTACHMENT_INDEX, body);
        }
        for (offset, length, name) in &self.metadata {
            let mut body = Vec::new();
            body.put_u64_le(*offset);
            body.put_u64_le(*length);
            put_text(&mut body, name);
            put_record(bytes, op::METADATA_INDEX, &body);
        }
    }

    fn statistics(&self) -> Vec<u8> {
        let mut body = Vec::new();
        body.put_u64_le(self.counts.values().sum());
        body.put_u16_le(self.declared.schemas.len() as u16);
        body.put_u32_le(self.declared.channels.len() as u32);
        body.put_u32_le(self.attachments.len() as u32);
        body.put_u32_le(self.metadata.len() as u32);
        body.put_u32_le(self.chunks.len() as u32);
        for time in self.span.unwrap_or_default() {
            body.put_u64_le(time);
        }
        body.put_u32_le(10 * self.counts.len() as u32);
        for (&channel, &count) in &self.counts {
            body.put_u16_le(channel);
            body.put_u64_le(count);
        }
        body
    }
}

/// The records that declare schemas and channels.
pub(super) fn declarations(declared: &Declarations) -> Vec<u8> {
    let mut bytes = Vec::new();
    put_declarations(&mut bytes, declared);
    bytes
}

fn put_declarations(bytes: &mut Vec<u8>, declared: &Declarations) {
    for body in declared.schemas.values() {
        put_record(bytes, op::SCHEMA, body);
    }
    for body in declared.channels.values() {
        put_record(bytes, op::CHANNEL, body);
    }
}

/// Appends the index of a chunk's messages, where `position` bytes of the file lie before `bytes`; gives where that of each
/// channel lies.
fn put_indexes(bytes: &mut Vec<u8>, messages: &ByChannel, position: u64) -> BTreeMap<u16, u64> {
    let mut indexes = BTreeMap::new();
    for (&channel, messages) in messages {
        indexes.insert(channel, position + bytes.len() as u64);
        let mut body = Vec::new();
        body.put_u16_le(channel);
        body.put_u32_le(16 * messages.len() as u32);
        for &(log_time, offset) in messages {
            body.put_u64_le(log_time);
            body.put_u64_le(offset);
        }
        put_record(bytes, op::MESSAGE_INDEX, &body);
    }
    indexes
}

fn put_record(bytes: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    bytes.put_u8(opcode);
    bytes.put_u64_le(body.len() as u64);
    bytes.extend_from_slice(body);
}

fn put_text(bytes: &mut Vec<u8>, text: &str) {
    bytes.put_u32_le(text.len() as u32);
    bytes.extend_from_slice(text.as_bytes());
}

fn put_texts(bytes: &mut Vec<u8>, texts: &Texts) {
    bytes.put_u32_le(texts.iter().map(|(key, value)| (8 + key.len() + value.len()) as u32).sum());
    for (key, value) in texts {
        put_text(bytes, key);
        put_text(bytes, value);
    }
}
