//! Reading a session.

use std::{
    fs::File,
    io::{Read, Seek},
    path::Path,
};

use super::{
    messages::{IntoMessages, Messages, Range},
    parts::{Parts, open_file},
};
#[cfg(feature = "rosbag2")]
use crate::container::foreign::{bag::SQLITE_MAGIC, rosbag2};
use crate::container::{ContainerError, Entry, Stream, Summary, foreign::bag::recording_file};

/// A session that is open for reading, in one file or several.
pub struct Session<R = File> {
    parts: Parts<R>,
    /// Host times that readers are restricted to.
    window: Option<[i64; 2]>,
}

impl Session<File> {
    /// Opens the session `path`; of a session in several files this is the first one, and the others are read with it as one. A later
    /// one is read by itself. Opens also a recording of rosbag2 in SQLite (with the feature `rosbag2`) or a folder
    /// with one. A session that was ended properly says at its end what it holds; another one is read
    /// through once.
    ///
    /// # Errors
    /// If the file cannot be read or is no session.
    pub fn open(path: &Path) -> Result<Self, ContainerError> {
        let path = &*recording_file(path)?;
        let file = open_file(path)?;
        #[cfg(feature = "rosbag2")]
        {
            let mut head = [0; 16];
            let mut start = &file;
            if start.read_exact(&mut head).is_ok() && head == *SQLITE_MAGIC {
                let mut session = Self::read(rosbag2::as_mcap(path)?, path)?;
                // The sizes are those of the copy, which nobody sees.
                let summary = &mut session.parts.summary;
                summary.file_bytes = file.metadata().map_or(0, |metadata| metadata.len());
                summary.whole_bytes = summary.file_bytes;
                return Ok(session);
            }
            start.rewind().map_err(|source| ContainerError::Read { path: path.to_owned(), offset: 0, source })?;
        }
        let mut session = Self::read(file, path)?;
        session.parts.join()?;
        Ok(session)
    }
}

impl<R: Read + Seek> Session<R> {
    /// As [`Session::open`], from anything that reads; `path` names it in errors. It is read by itself, also if it is a part of a
    /// session in several files.
    ///
    /// # Errors
    /// If it cannot be read or is no session.
    pub fn read(file: R, path: &Path) -> Result<Self, ContainerError> {
        Ok(Self { parts: Parts::one(file, path)?, window: None })
    }

    /// The file's name; of a session in several files that of the first.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.parts.files[0].path
    }

    /// What the session holds.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        &self.parts.summary
    }

    /// The stream of this name.
    ///
    /// # Errors
    /// If there is none; the message lists those that there are.
    pub fn stream(&self, id: &str) -> Result<(usize, &Stream), ContainerError> {
        self.summary().stream(id).ok_or_else(|| {
            let known: Vec<&str> = self.summary().streams.iter().map(|stream| stream.description.id.as_str()).collect();
            ContainerError::UnknownStream { path: self.path().to_owned(), id: id.to_owned(), known: known.join(", ") }
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
        let gone = match from_host_ns {
            Some(from) => self.parts.go_to(self.parts.summary.start.log_time(from)),
            None => self.parts.begin(0),
        };
        let from_ns = from_host_ns.unwrap_or(i64::MIN);
        let range = Range { from_ns, to_ns, in_one_file: false, failed: gone.err(), over: false };
        Messages { parts: &mut self.parts, range }
    }

    /// As [`Session::messages`], with the session kept in what gives them.
    #[must_use]
    pub fn into_messages(mut self, from_host_ns: Option<i64>) -> IntoMessages<R> {
        let Messages { range, .. } = self.messages(from_host_ns);
        IntoMessages { parts: self.parts, range }
    }

    /// Whether the whole file was read when it was opened, as its end did not say what it holds: what is damaged is known
    /// then.
    #[must_use]
    pub fn was_read_through(&self) -> bool {
        self.parts.files.iter().all(|file| !file.indexed)
    }

    /// Reads everything, and verifies the checksums: one message for each place that is damaged, and one if the packets are
    /// others than the end of the file says. `progress` is called with the bytes of packets so far.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn check(&mut self, mut progress: impl FnMut(u64)) -> Result<Vec<String>, ContainerError> {
        let (mut damage, mut bytes) = (Vec::new(), 0);
        let [from_ns, to_ns] = self.window.unwrap_or([i64::MIN, i64::MAX]);
        for file in 0..self.parts.files.len() {
            self.parts.begin(file)?;
            let range = Range { from_ns, to_ns, in_one_file: true, failed: None, over: false };
            for entry in (Messages { parts: &mut self.parts, range }) {
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
                damage.extend(self.parts.file().lacking(&self.parts.walk));
            }
        }
        Ok(damage)
    }

    /// Gives the file back.
    pub fn into_inner(self) -> R {
        self.parts.walk.framing.into_inner()
    }
}
