//! Numbers that are written once and then read in ranges: in memory, or in a file where memory is not meant for them.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom, Write},
    path::Path,
    sync::{Mutex, PoisonError},
};

/// Numbers that are written to the file, or read from it, at once.
const PIECE: usize = 1 << 16;

/// A list of numbers.
#[derive(Debug)]
pub(super) enum Words {
    Kept(Vec<u32>),
    Filed(Filed),
}

/// Numbers in a file that has no name, so that it is gone with the process however that ends.
#[derive(Debug)]
pub(super) struct Filed {
    file: Mutex<File>,
    /// Numbers in the file.
    length: usize,
    /// Those that follow, not written yet.
    next: Vec<u32>,
}

impl Words {
    /// None yet: in a file in `folder`, or in memory.
    pub fn new(folder: Option<&Path>) -> io::Result<Self> {
        Ok(match folder {
            None => Self::Kept(Vec::new()),
            Some(folder) => {
                Self::Filed(Filed { file: Mutex::new(tempfile::tempfile_in(folder)?), length: 0, next: Vec::new() })
            }
        })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Kept(words) => words.len(),
            Self::Filed(filed) => filed.length + filed.next.len(),
        }
    }

    /// Appends one.
    pub fn push(&mut self, word: u32) -> io::Result<()> {
        match self {
            Self::Kept(words) => words.push(word),
            Self::Filed(filed) => {
                filed.next.push(word);
                if filed.next.len() >= PIECE {
                    filed.write()?;
                }
            }
        }
        Ok(())
    }

    /// No other follows.
    pub fn finish(&mut self) -> io::Result<()> {
        match self {
            Self::Kept(words) => words.shrink_to_fit(),
            Self::Filed(filed) => {
                filed.write()?;
                filed.next = Vec::new();
            }
        }
        Ok(())
    }

    /// Hands `length` numbers over from number `first` on, piece by piece; each with how many of them came before. All must have been
    /// finished.
    pub fn read(&self, first: usize, length: usize, mut take: impl FnMut(usize, &[u32])) -> io::Result<()> {
        let filed = match self {
            Self::Kept(words) => {
                take(0, &words[first..first + length]);
                return Ok(());
            }
            Self::Filed(filed) => filed,
        };
        let mut piece = vec![0_u32; length.min(PIECE)];
        let mut done = 0;
        while done < length {
            let piece = &mut piece[..(length - done).min(PIECE)];
            let mut file = filed.file.lock().unwrap_or_else(PoisonError::into_inner);
            file.seek(SeekFrom::Start(4 * (first + done) as u64))?;
            file.read_exact(bytemuck::cast_slice_mut(piece))?;
            drop(file);
            take(done, piece);
            done += piece.len();
        }
        Ok(())
    }
}

impl Filed {
    fn write(&mut self) -> io::Result<()> {
        let file = self.file.get_mut().unwrap_or_else(PoisonError::into_inner);
        file.write_all(bytemuck::cast_slice(&self.next))?;
        self.length += self.next.len();
        self.next.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_the_same_in_memory_and_in_a_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let count = 2 * PIECE + 5;
        for folder in [None, Some(folder.path())] {
            let mut words = Words::new(folder).expect("a file");
            (0..count).for_each(|at| words.push(7 * at as u32).expect("written"));
            assert_eq!(words.len(), count);
            words.finish().expect("written");
            for (first, length) in [(0, 0), (0, 3), (PIECE - 1, 2), (3, count - 3), (count, 0)] {
                let mut read = Vec::new();
                let take = |before: usize, piece: &[u32]| {
                    assert_eq!(before, read.len());
                    read.extend_from_slice(piece);
                };
                words.read(first, length, take).expect("read");
                assert!(read.into_iter().eq((first..first + length).map(|at| 7 * at as u32)), "{first} {length}");
            }
        }
        assert!(std::fs::read_dir(folder.path()).expect("a folder").next().is_none(), "the file has no name");
        assert!(Words::new(Some(&folder.path().join("none"))).is_err());
    }
}
