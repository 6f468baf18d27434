//! A recorded file of EVT3 words, sent again word for word.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use thiserror::Error;

/// Why a recording cannot be played.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("cannot read the recording {path}: {source}; check the path")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file's header names another format.
    #[error("{path} holds {format}, and the emulated sensor plays EVT3 alone; convert it with `erfgs export --to raw`")]
    Format {
        /// The file.
        path: PathBuf,
        /// What its header says.
        format: String,
    },
}

/// The words of a file, paced by the times that they carry, from the start of streaming on. After the last word the
/// sensor sees nothing.
#[derive(Clone, Debug)]
pub struct RecordedWords {
    words: Vec<u8>,
    at: usize,
    high: Option<u64>,
    /// Time of the last time word, and of the first one.
    time_us: u64,
    zero_us: Option<u64>,
}

impl RecordedWords {
    /// Plays words as they are.
    #[must_use]
    pub fn new(words: Vec<u8>) -> Self {
        Self { words, at: 0, high: None, time_us: 0, zero_us: None }
    }

    /// Plays a RAW file: its header lines are skipped.
    ///
    /// # Errors
    /// If the file cannot be read, or its header says that it is not EVT3.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let bytes = fs::read(path).map_err(|source| RecordingError::Read { path: path.to_owned(), source })?;
        let mut start = 0;
        while bytes[start..].starts_with(b"% ") {
            let line = bytes[start..].split_inclusive(|&byte| byte == b'\n').next().unwrap_or_default();
            start += line.len();
            let text = String::from_utf8_lossy(line);
            let format = text.strip_prefix("% evt ").or_else(|| text.strip_prefix("% format ")).map(str::trim);
            if let Some(format) = format.filter(|format| !(*format == "3.0" || format.starts_with("EVT3"))) {
                return Err(RecordingError::Format { path: path.to_owned(), format: format.to_owned() });
            }
            if text.starts_with("% end") {
                break;
            }
        }
        Ok(Self::new(bytes[start..].to_vec()))
    }

    /// Starts from the beginning.
    pub fn rewind(&mut self) {
        *self = Self::new(std::mem::take(&mut self.words));
    }

    /// The words of the next stretch, up to `elapsed_us` after the first time in the file.
    pub fn until(&mut self, elapsed_us: u64) -> &[u8] {
        let start = self.at;
        while let Some(&[low, high]) = self.words.get(self.at..self.at + 2).and_then(|word| word.first_chunk::<2>()) {
            let word = u16::from_le_bytes([low, high]);
            let payload = u64::from(word & 0xfff);
            match word >> 12 {
                8 => {
                    // The 24-bit time rolls over every 16.8 s.
                    let loops = self.time_us >> 24;
                    let wrapped = self.high.is_some_and(|last| payload + 2048 < last);
                    self.high = Some(payload);
                    self.time_us = (loops + u64::from(wrapped)) << 24 | payload << 12;
                }
                6 if self.high.is_some() => self.time_us = self.time_us & !0xfff | payload,
                _ => {}
            }
            if self.high.is_some() {
                let zero = *self.zero_us.get_or_insert(self.time_us);
                if self.time_us.saturating_sub(zero) > elapsed_us {
                    break;
                }
            }
            self.at += 2;
        }
        &self.words[start..self.at]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(words: &[u16]) -> Vec<u8> {
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    #[test]
    fn words_come_when_their_time_has_come_and_none_is_lost() {
        let all = bytes(&[0x0001, 0x8001, 0x6010, 0x2005, 0x6020, 0x2006, 0x8002, 0x6000, 0x2007]);
        let mut play = RecordedWords::new(all.clone());
        let mut sent = play.until(0).to_vec();
        // The first time is that of the TIME_HIGH alone: 0x1000; 0x1010 is 16 us later.
        assert_eq!(sent, bytes(&[0x0001, 0x8001]));
        sent.extend(play.until(0x1f));
        assert_eq!(sent, bytes(&[0x0001, 0x8001, 0x6010, 0x2005]));
        sent.extend(play.until(u64::MAX));
        assert_eq!(sent, all);
        assert!(play.until(u64::MAX).is_empty());
    }

    #[test]
    fn a_roll_over_goes_on() {
        let mut play = RecordedWords::new(bytes(&[0x8fff, 0x6fff, 0x2001, 0x8000, 0x6001, 0x2002]));
        assert_eq!(play.until(4095).len(), 6);
        assert_eq!(play.until(4097).len(), 6);
    }
}
