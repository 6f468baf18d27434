//! A recording, whatever file holds it: a session, or an event file of another program.

use std::{fs::File, io::Read, path::Path};

use super::Session;
use crate::container::{
    ContainerError, DecodedStream, Entry, EventFileRecording, Stream, Summary,
    foreign::bag::{SQLITE_MAGIC, recording_file},
};
use erfgs_events::{EventFileError, EventFileHints, SensorSize, Sink};

/// A session, a recording of ROS 2, or an event file, read in the same way.
pub enum Recording {
    /// An MCAP file.
    Session(Box<Session>),
    /// Any other.
    EventFile(Box<EventFileRecording>),
}

impl Recording {
    /// Opens a recording. Of an event file `size` is taken for the sensor's, whatever the file says; a session knows its own.
    ///
    /// # Errors
    /// If the file cannot be read or is none of the formats.
    pub fn open(path: &Path, size: Option<SensorSize>) -> Result<Self, ContainerError> {
        Self::open_with(path, &EventFileHints { size, ..EventFileHints::default() })
    }

    /// As [`Recording::open`], with what the user says of an event file.
    ///
    /// # Errors
    /// If the file cannot be read or is none of the formats, or has columns given and is no text.
    pub fn open_with(path: &Path, hints: &EventFileHints) -> Result<Self, ContainerError> {
        let path = &*recording_file(path)?;
        let mut head = Vec::new();
        let file = erfgs_base::regular::check(path).and_then(|()| File::open(path));
        let file = file.map_err(|source| ContainerError::Open { what: "open", path: path.to_owned(), source })?;
        let read = file.take(16).read_to_end(&mut head);
        read.map_err(|source| ContainerError::Read { path: path.to_owned(), offset: 0, source })?;
        let named = |name: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(name));
        if named("mcap") || head.starts_with(mcap::MAGIC) || head == *SQLITE_MAGIC {
            if hints.columns.is_some() {
                let error = EventFileError::NoText { path: path.to_owned(), format: "a session" };
                return Err(ContainerError::event_file(path, error));
            }
            return Session::open(path).map(|session| Self::Session(Box::new(session)));
        }
        EventFileRecording::open(path, hints).map(|file| Self::EventFile(Box::new(file)))
    }

    /// The file's name.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Session(session) => session.path(),
            Self::EventFile(file) => file.path(),
        }
    }

    /// What it holds. Packets of an event file are not counted.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        match self {
            Self::Session(session) => session.summary(),
            Self::EventFile(file) => file.summary(),
        }
    }

    /// The stream of this name.
    ///
    /// # Errors
    /// If there is none; the message lists those that there are.
    pub fn stream(&self, id: &str) -> Result<(usize, &Stream), ContainerError> {
        let summary = self.summary();
        summary.stream(id).ok_or_else(|| {
            let known: Vec<&str> = summary.streams.iter().map(|stream| stream.description.id.as_str()).collect();
            ContainerError::UnknownStream { path: self.path().to_owned(), id: id.to_owned(), known: known.join(", ") }
        })
    }

    /// Restricts what is read from here on to what arrived within these session times, nanoseconds, the last one included;
    /// `None` lifts that. Packets of a session are whole: what they hold is older by some milliseconds.
    pub fn restrict(&mut self, window_ns: Option<[i64; 2]>) {
        let start_ns = self.summary().start.host_ns;
        let window = window_ns.map(|window| window.map(|session_ns| start_ns.saturating_add(session_ns)));
        match self {
            Self::Session(session) => session.restrict(window),
            Self::EventFile(file) => file.restrict(window),
        }
    }

    /// What to say where `packets` of a stream were read and there should be more. Of a range nobody knows.
    #[cfg(feature = "export")]
    pub(crate) fn lacking(&self, stream: usize, packets: u64) -> Option<String> {
        let restricted = match self {
            Self::Session(session) => session.window().is_some(),
            Self::EventFile(_) => true,
        };
        let recorded = self.summary().streams.get(stream).filter(|_| !restricted)?;
        super::decode::lacking(&recorded.description.id, packets, recorded.totals.packets)
    }

    /// The messages in the order of the file: see [`Session::messages`] and [`EventFileRecording::messages`].
    pub fn messages(
        &mut self,
        from_host_ns: Option<i64>,
    ) -> Box<dyn Iterator<Item = Result<Entry, ContainerError>> + '_> {
        match self {
            Self::Session(session) => Box::new(session.messages(from_host_ns)),
            Self::EventFile(file) => Box::new(file.messages(from_host_ns)),
        }
    }

    /// As [`Recording::messages`], with the recording kept in what gives them.
    #[must_use]
    pub fn into_messages(
        self,
        from_host_ns: Option<i64>,
    ) -> Box<dyn Iterator<Item = Result<Entry, ContainerError>> + Send> {
        match self {
            Self::Session(session) => Box::new(session.into_messages(from_host_ns)),
            Self::EventFile(file) => Box::new(file.messages(from_host_ns)),
        }
    }

    /// The same recording opened for another reader. Of a session that was not ended this reads the whole file again.
    ///
    /// # Errors
    /// If the file is gone or has become another.
    pub fn again(&self) -> Result<Self, ContainerError> {
        match self {
            Self::Session(session) => Session::open(session.path()).map(|session| Self::Session(Box::new(session))),
            Self::EventFile(file) => Ok(Self::EventFile(file.clone())),
        }
    }

    /// Decodes all events of a stream: see [`Session::decode_events`] and [`EventFileRecording::decode_events`].
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn decode_events(
        &mut self,
        stream: usize,
        sink: &mut impl Sink,
        progress: impl FnMut(u64),
    ) -> Result<Option<DecodedStream>, ContainerError> {
        match self {
            Self::Session(session) => session.decode_events(stream, None, sink, progress),
            Self::EventFile(file) if stream == 0 => file.decode_events(sink, progress).map(Some),
            Self::EventFile(_) => Ok(None),
        }
    }
}
