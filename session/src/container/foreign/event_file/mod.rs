//! Event files as recordings: one stream, whose packets are made while the file is read.
//!
//! | File | Packets |
//! |---|---|
//! | RAW | the file's own words, cut where 5 ms are over |
//! | DAT, AEDAT 2, HDF5 in Metavision's layout | EVT 2 words, which have edges of all inputs |
//! | AEDAT 4, CSV, NPZ, HDF5 in DSEC's layout | packets of AEDAT 4, which have frames, inertial samples, marks and times of 64 bits |
//!
//! Either way a decoder gives what the file gives: the same events in the same order with the same times. A packet's host
//! time is the time of its last item, counted from the first item of the file.

mod cut;
mod describe;
mod host_clock;
mod pack;
mod packets;
mod source;
mod survey;
mod within;

use std::{
    cell::Cell,
    path::{Path, PathBuf},
};

pub use host_clock::HostClock;

use self::{packets::Packets, source::EventSource, within::Within};
use crate::container::{BegunDecoder, ContainerError, DecodedStream, Entry, Summary};
use erfgs_events::{EventEncoding, EventFileHints, SensorSize, Sink, StreamDecoder};

/// An event file that was read through once.
#[derive(Clone)]
pub struct EventFileRecording {
    path: PathBuf,
    source: EventSource,
    summary: Summary,
    first_us: u64,
    /// Host times that readers are restricted to.
    window: Option<[i64; 2]>,
}

impl EventFileRecording {
    /// Opens an event file and reads it through for its span; `hints` are taken whatever the file says. Where nothing says the
    /// sensor's size, it is what holds all addresses.
    ///
    /// # Errors
    /// If the file cannot be read, or is none that erfgs reads.
    pub fn open(path: &Path, hints: &EventFileHints) -> Result<Self, ContainerError> {
        let mut source = EventSource::open(path, hints)?;
        let survey = survey::survey(&source, hints.size.is_none())?;
        let of_addresses = source.size().is_none();
        if of_addresses {
            let extent = survey.extent.map(SensorSize::checked).transpose();
            let far = |wrong| format!("some of its events lie far outside of all sensors ({wrong}), or with --size");
            source.set_size(extent.map_err(|wrong| ContainerError::event_file(path, far(wrong)))?);
        }
        let mut summary = describe::summary(path, &source, &survey, of_addresses);
        summary.damage = survey.faults;
        Ok(Self { path: path.to_owned(), source, summary, first_us: survey.first_us, window: None })
    }

    /// The file's name.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the file holds, as a session would say it. Packets are not counted.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// The packets, from host time `from_host_ns` on; `None` for all.
    pub fn messages(&self, from_host_ns: Option<i64>) -> impl Iterator<Item = Result<Entry, ContainerError>> + use<> {
        let [from, to] = self.window.unwrap_or([i64::MIN, i64::MAX]);
        let from = from_host_ns.map_or(from, |asked| asked.max(from));
        let packets = Packets::start(self.source.clone(), self.encoding(), self.first_us);
        packets
            .take_while(move |packet| packet.as_ref().map_or(true, |packet| packet.host_ns <= to))
            .filter(move |packet| packet.as_ref().map_or(true, |packet| packet.host_ns >= from))
            .map(|packet| packet.map(|packet| Entry::Packet { stream: 0, packet }))
    }

    /// Restricts [`EventFileRecording::messages`] and [`EventFileRecording::decode_events`] to these host times, the last one
    /// included; `None` lifts that.
    pub fn restrict(&mut self, window_host_ns: Option<[i64; 2]>) {
        self.window = window_host_ns;
    }

    /// Decodes the file into `sink`; `progress` is called with the bytes read so far, where the format is read piece by
    /// piece.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn decode_events(
        &self,
        sink: &mut impl Sink,
        mut progress: impl FnMut(u64),
    ) -> Result<DecodedStream, ContainerError> {
        let Some(window) = self.window else {
            return self.decode_events_while(sink, |bytes| {
                progress(bytes);
                true
            });
        };
        let over = Cell::new(false);
        let mut within = Within::new(sink, HostClock::new(self.first_us), window, &over);
        let anomalies = self.source.decode(&mut within, |bytes| {
            progress(bytes);
            !over.get()
        })?;
        Ok(DecodedStream { anomalies, ..DecodedStream::default() })
    }

    /// Decodes the file into `sink`, whatever readers are restricted to, for as long as `go_on` says so, which is called with the
    /// bytes read so far, where the format is read piece by piece.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn decode_events_while(
        &self,
        sink: &mut impl Sink,
        go_on: impl FnMut(u64) -> bool,
    ) -> Result<DecodedStream, ContainerError> {
        let anomalies = self.source.decode(sink, go_on)?;
        Ok(DecodedStream { anomalies, ..DecodedStream::default() })
    }

    /// A decoder of the packets that [`EventFileRecording::messages`] gives.
    #[must_use]
    pub fn decoder(&self) -> BegunDecoder {
        let decoder = StreamDecoder::new(self.encoding(), self.source.size());
        BegunDecoder { decoder, first_sequence: 0, host_ns: None }
    }

    /// The device's time of the first item, microseconds: host time 0.
    #[must_use]
    pub fn first_us(&self) -> u64 {
        self.first_us
    }

    /// The clock that the file's times are told on, at its beginning.
    #[must_use]
    pub fn clock(&self) -> HostClock {
        HostClock::new(self.first_us)
    }

    fn encoding(&self) -> EventEncoding {
        self.source.encoding()
    }
}
