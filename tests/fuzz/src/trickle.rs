//! A file that is read a few bytes at a time.

use std::io::{Cursor, Read, Result, Seek, SeekFrom};

/// Bytes in memory, of which each call of `read` gives at most so many.
pub struct Trickle<'a> {
    bytes: Cursor<&'a [u8]>,
    most: usize,
}

impl<'a> Trickle<'a> {
    /// `most` bytes at a time, and at least one.
    pub fn new(bytes: &'a [u8], most: usize) -> Self {
        Self { bytes: Cursor::new(bytes), most: most.max(1) }
    }
}

impl Read for Trickle<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let length = buffer.len().min(self.most);
        self.bytes.read(&mut buffer[..length])
    }
}

impl Seek for Trickle<'_> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.bytes.seek(to)
    }
}
