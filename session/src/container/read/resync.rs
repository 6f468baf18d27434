//! Going on where a record is damaged: a chunk is known by its fields and its checksum, whatever its record says.

use std::io::{Read, Seek};

use bytes::Bytes;
use mcap::records::{ChunkHeader, op};

use super::{
    framing::{Framing, Head, MAX_BODY},
    mend::{FIELDS, content_length, fields_of, flipped_bit},
};
use crate::container::ContainerError;

/// Bytes that are looked through at once.
const PIECE: usize = 1 << 20;

/// A chunk as it was before it was damaged.
pub(in crate::container) struct Mended {
    pub head: Head,
    pub header: ChunkHeader,
    pub content: Bytes,
    /// What was wrong.
    pub what: String,
    /// The bytes of the file that were others.
    pub patches: Vec<(u64, u8)>,
}

impl<R: Read + Seek> Framing<R> {
    /// Whether a record may begin at `offset`, or the file ends there. A record that was cut off may, and a chunk whose fields
    /// are damaged.
    pub fn is_plausible(&mut self, offset: u64) -> Result<bool, ContainerError> {
        Ok(self.may_be_record(offset)? || self.mended(offset)?.is_some())
    }

    fn may_be_record(&mut self, offset: u64) -> Result<bool, ContainerError> {
        let head = self.piece(offset.min(self.length()), 9)?;
        let Some((&opcode, length)) = head.split_first().filter(|_| head.len() == 9) else { return Ok(true) };
        let length = length.iter().rev().fold(0, |length, &byte| length << 8 | u64::from(byte));
        let known = (op::HEADER..=op::DATA_END).contains(&opcode);
        let fits = length <= self.length() - offset - 9;
        Ok(if known { fits || length <= MAX_BODY } else { opcode >= 0x80 && fits })
    }

    /// Where the next chunk lies whose lengths agree, from `from` on.
    pub fn next_chunk(&mut self, from: u64) -> Result<Option<u64>, ContainerError> {
        // What was looked through once is not looked through again, wherever a file leads to.
        if let Some((before, found)) = self.searched
            && from >= before
            && found.is_none_or(|found| found >= from)
        {
            return Ok(found);
        }
        let found = self.look_for_chunk(from)?;
        self.searched = Some((from, found));
        Ok(found)
    }

    fn look_for_chunk(&mut self, from: u64) -> Result<Option<u64>, ContainerError> {
        let mut at = from;
        while at + (FIELDS as u64) <= self.length() {
            let piece = self.piece(at, PIECE + FIELDS)?;
            let room = self.length() - at;
            let found = (0..=piece.len() - FIELDS).find(|&from| {
                let fields = piece[from..].first_chunk::<FIELDS>();
                piece[from] == op::CHUNK && fields.is_some_and(|fields| is_chunk(fields, room - from as u64))
            });
            if let Some(found) = found {
                return Ok(Some(at + found as u64));
            }
            at += (piece.len() + 1).saturating_sub(FIELDS).max(1) as u64;
        }
        Ok(None)
    }

    /// The chunk at `offset`, if its content is not compressed and its checksum tells what it was before one of its fields was
    /// damaged, or a bit of its content flipped. Without a checksum the fields alone can be put right, where their record is
    /// followed by another.
    pub fn mended(&mut self, offset: u64) -> Result<Option<Mended>, ContainerError> {
        let room = self.length().saturating_sub(offset);
        let fields = self.piece(offset, FIELDS)?;
        let Some(fields) = fields.first_chunk::<FIELDS>() else { return Ok(None) };
        let Some(length) = content_length(fields, room).filter(|&length| length <= MAX_BODY) else { return Ok(None) };
        let Some(room_left) = self.room_to_mend.checked_sub(length) else { return Ok(None) };
        self.room_to_mend = room_left;
        let start = offset + FIELDS as u64;
        let mut content = self.piece(start, length as usize)?;
        let stated = u32::from_le_bytes(std::array::from_fn(|i| fields[33 + i]));
        let difference = crc32fast::hash(&content) ^ stated;
        let whole = fields_of(*fields, &content);
        // The checksum itself is a field; where there is none, none is made up.
        let fields_damaged = whole[..33] != fields[..33] || whole[37..] != fields[37..];
        let mut patches = Vec::new();
        let mut mend_fields = |whole: &[u8; FIELDS], checksum: bool| {
            for (at, (&right, &found)) in whole.iter().zip(fields).enumerate() {
                if right != found && (checksum || !(33..37).contains(&at)) {
                    patches.push((offset + at as u64, right));
                }
            }
        };
        let what = if stated == 0 {
            if !fields_damaged || !self.may_be_record(start + length)? {
                return Ok(None);
            }
            mend_fields(&whole, false);
            "the fields of the chunk were damaged"
        } else if difference == 0 && fields_damaged {
            mend_fields(&whole, false);
            "the fields of the chunk were damaged"
        } else if difference.count_ones() == 1 && !fields_damaged {
            mend_fields(&whole, true);
            "a bit of the chunk's checksum flipped"
        } else if let Some((byte, bit)) = flipped_bit(content.len(), difference).filter(|_| !fields_damaged) {
            content[byte] ^= 1 << bit;
            patches.push((start + byte as u64, content[byte]));
            "a bit of the chunk flipped"
        } else {
            return Ok(None);
        };
        let u64_at = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| fields[at + i]));
        let header = ChunkHeader {
            message_start_time: u64_at(9),
            message_end_time: u64_at(17),
            uncompressed_size: length,
            uncompressed_crc: if stated == 0 { 0 } else { crc32fast::hash(&content) },
            compression: String::new(),
            compressed_size: length,
        };
        let head = Head { opcode: op::CHUNK, offset, length: length + 40 };
        let what = format!("{what}: corrected from the redundant data");
        Ok(Some(Mended { head, header, content: content.into(), what, patches }))
    }
}

/// Whether a chunk may begin with these fields, with so many bytes to the end of the file.
fn is_chunk(fields: &[u8; FIELDS], room: u64) -> bool {
    let u64_at = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| fields[at + i]));
    let [length, start, end] = [u64_at(1), u64_at(9), u64_at(17)];
    if length < 40 || length > room.saturating_sub(9) || start > end {
        return false;
    }
    let name = u32::from_le_bytes(std::array::from_fn(|i| fields[37 + i])) as usize;
    match (name, fields.get(41..41 + name)) {
        (0, _) => u64_at(41) == length - 40 && u64_at(25) == length - 40,
        // The length of what is packed lies behind the name, and may reach past the fields.
        (3, Some(b"lz4")) | (4, Some(b"zstd")) => u64_at(25) > 0 && u64_at(25) <= MAX_BODY,
        _ => false,
    }
}
