//! The records of an MCAP file, one after the other: an opcode, a length, a body.

use std::{
    io::{BufReader, Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

use bytes::Bytes;

use crate::container::ContainerError;

/// Opcode and length before the body of a record.
const PREFIX: u64 = 9;
/// Longer records, and chunks that hold more when they are unpacked, are refused rather than read into memory.
pub(super) const MAX_BODY: u64 = 1 << 30;

/// So many bytes may be read to mend chunks besides twice the length of the file.
const MEND_MORE: u64 = 1 << 20;

/// Where a record lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::container) struct Head {
    pub opcode: u8,
    /// Where it starts in the file.
    pub offset: u64,
    /// Length of its body.
    pub length: u64,
}

impl Head {
    /// Where its body starts.
    pub fn body(&self) -> u64 {
        self.offset + PREFIX
    }

    /// The byte after it.
    pub fn end(&self) -> u64 {
        self.body() + self.length
    }
}

/// Walks over the records of a file.
pub(in crate::container) struct Framing<R> {
    file: BufReader<R>,
    path: PathBuf,
    length: u64,
    position: u64,
    /// Bytes of chunks that may still be read to see whether they can be mended.
    pub room_to_mend: u64,
    /// From where the next chunk was looked for, and where it lies.
    pub searched: Option<(u64, Option<u64>)>,
}

impl<R: Read + Seek> Framing<R> {
    /// Stands before the first record of `file`.
    pub fn open(file: R, path: &Path) -> Result<Self, ContainerError> {
        let mut file = BufReader::with_capacity(1 << 16, file);
        let failed = |source| ContainerError::Read { path: path.to_owned(), offset: 0, source };
        let length = file.seek(SeekFrom::End(0)).map_err(failed)?;
        file.rewind().map_err(failed)?;
        let mut framing = Self { file, path: path.to_owned(), length, position: 0, room_to_mend: 0, searched: None };
        framing.begin_pass();
        if length == 0 {
            return Err(ContainerError::Empty { path: path.to_owned() });
        }
        if framing.left() < mcap::MAGIC.len() as u64 || framing.array::<8>()? != mcap::MAGIC {
            return Err(ContainerError::NotMcap { path: path.to_owned() });
        }
        Ok(framing)
    }

    /// The file is read anew: what may be mended is counted from nothing. Each chunk may be once, and some more; what is made up
    /// may overlap without end.
    pub fn begin_pass(&mut self) {
        self.room_to_mend = self.length.saturating_mul(2).saturating_add(MEND_MORE);
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file.
    pub fn length(&self) -> u64 {
        self.length
    }

    fn left(&self) -> u64 {
        self.length.saturating_sub(self.position)
    }

    /// Goes to any byte of the file.
    pub fn go_to(&mut self, offset: u64) -> Result<(), ContainerError> {
        let forward = i128::from(offset) - i128::from(self.position);
        let moved = match i64::try_from(forward) {
            Ok(forward) => self.file.seek_relative(forward),
            Err(_) => self.file.seek(SeekFrom::Start(offset)).map(drop),
        };
        moved.map_err(|source| ContainerError::Read { path: self.path.clone(), offset, source })?;
        self.position = offset;
        Ok(())
    }

    /// The record at the place where the file stands; the file stands before its body then. `None` if the file ends
    /// before the record does, or no record starts here.
    pub fn head(&mut self) -> Result<Option<Head>, ContainerError> {
        let offset = self.position;
        if self.left() < PREFIX {
            return Ok(None);
        }
        let [opcode, length @ ..] = self.array::<9>()?;
        let head = Head { opcode, offset, length: u64::from_le_bytes(length) };
        // A file system that lost power may leave zeros where data was to come; no record has opcode 0.
        let whole = opcode != 0 && head.length <= self.left();
        Ok(whole.then_some(head))
    }

    /// The body of a record.
    pub fn body(&mut self, head: &Head) -> Result<Bytes, ContainerError> {
        if head.length > MAX_BODY {
            return Err(ContainerError::Damaged {
                path: self.path.clone(),
                offset: head.offset,
                what: format!("a record of {} bytes is longer than erfgs reads", head.length),
            });
        }
        self.go_to(head.body())?;
        let mut body = vec![0; head.length as usize];
        self.fill(&mut body)?;
        Ok(body.into())
    }

    /// Up to `most` bytes from `offset` on; fewer at the end of the file.
    pub fn piece(&mut self, offset: u64, most: usize) -> Result<Vec<u8>, ContainerError> {
        self.go_to(offset)?;
        let mut bytes = vec![0; most.min(usize::try_from(self.left()).unwrap_or(usize::MAX))];
        self.fill(&mut bytes)?;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ContainerError> {
        let mut bytes = [0; N];
        self.fill(&mut bytes)?;
        Ok(bytes)
    }

    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), ContainerError> {
        self.file.read_exact(bytes).map_err(|source| ContainerError::Read {
            path: self.path.clone(),
            offset: self.position,
            source,
        })?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Whether the closing magic stands at `offset` and the file ends with it.
    pub fn closed_at(&mut self, offset: u64) -> Result<bool, ContainerError> {
        if offset.checked_add(mcap::MAGIC.len() as u64) != Some(self.length) {
            return Ok(false);
        }
        self.go_to(offset)?;
        Ok(self.array::<8>()? == mcap::MAGIC)
    }

    /// The file.
    pub fn into_inner(self) -> R {
        self.file.into_inner()
    }
}
