//! What a recording holds, read with times of the session clock: events within a span, frames with their exposures, and slices of
//! all cameras.
//!
//! A session takes its clocks from its [`Synchronisation`]. The file of one event camera has no other clock to agree with: its session
//! time begins with its first item and goes with the camera.

mod error;
mod feed;
mod follow;
mod frame;
mod frames;
mod picture;
mod slices;
mod times;

use std::{cell::Cell, collections::HashMap, path::Path, sync::Arc};

use erfgs_events::{EventFileHints, EventRows};
use erfgs_scene::pixel::{self, PixelFormat};
use erfgs_session::{
    Recording,
    clock::Exposure,
    container::{BegunDecoder, Stream},
    export::sample_bits,
    source::{Description, LATE_NS},
};

pub use self::{
    error::ReadError,
    frame::TimedFrame,
    frames::Frames,
    picture::{Picture, Samples},
    slices::{Part, Slice, SliceOptions, Slices},
    times::Dater,
};
use self::{
    feed::{Feed, Taking},
    follow::Follow,
    times::Clocks,
};
use crate::{SyncNote, Synchronisation, of_session};

/// A span of session time without bounds.
pub const ALWAYS_NS: [i64; 2] = [i64::MIN, i64::MAX];

/// Packets arrive after what they hold. Clocks that are fitted to edges may put it later by less than this, nanoseconds.
const SLACK_NS: i64 = 100_000_000;

/// On which clock the times of events are told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EventClock {
    /// The session's.
    #[default]
    Session,
    /// The camera's own, as recorded.
    Device,
}

/// How many bits the samples of a frame are given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth {
    /// 8.
    #[default]
    Bits8,
    /// 16.
    Bits16,
    /// 16 where the camera gives more than 8, and 8 elsewhere.
    OfCamera,
}

impl Depth {
    /// Whether frames of these pixels are given 16 bits.
    fn is_deep(self, pixels: PixelFormat) -> bool {
        match self {
            Self::Bits8 => false,
            Self::Bits16 => true,
            Self::OfCamera => pixel::is_deep(pixels),
        }
    }
}

/// How the frames of a stream are decoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameLook {
    /// How many bits a sample is given.
    pub depth: Depth,
    /// How many bits of samples of 16 count (AEDAT 4), where it is said.
    pub bits: Option<u8>,
}

/// Events of a stream, and what of it could not be read.
#[derive(Debug, Default)]
pub struct TimedEvents {
    /// The events in the order of their times; times of the session are rounded down to microseconds.
    pub rows: EventRows,
    /// What was passed over, a message each.
    pub damage: Vec<String>,
}

/// A recording and its clocks, which are found when they are first needed.
pub struct TimedRecording {
    recording: Recording,
    clocks: Option<Arc<Clocks>>,
    notes: Vec<SyncNote>,
}

impl From<Recording> for TimedRecording {
    fn from(recording: Recording) -> Self {
        Self { recording, clocks: None, notes: Vec::new() }
    }
}

impl TimedRecording {
    /// Opens a session or an event file; `hints` are taken whatever an event file says.
    ///
    /// # Errors
    /// If the file cannot be read or is none of the formats.
    pub fn open(path: &Path, hints: &EventFileHints) -> Result<Self, ReadError> {
        Ok(Recording::open_with(path, hints)?.into())
    }

    /// The recording.
    #[must_use]
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// From the session's beginning to the arrival of its last packet, nanoseconds of session time.
    #[must_use]
    pub fn span_ns(&self) -> [i64; 2] {
        let summary = self.recording.summary();
        let last = summary.span_ns().map_or(0, |[_, last]| summary.start.session_ns(last));
        [0, last.saturating_add(1)]
    }

    /// The clocks of a session: those in the file beside it, or fitted now, for which the session is read through. `None` for the file
    /// of one event camera.
    ///
    /// # Errors
    /// If the file beside the session, or the session, cannot be read.
    pub fn synchronisation(&mut self) -> Result<Option<Synchronisation>, ReadError> {
        Ok(match &*self.clocks()? {
            Clocks::Fitted(sync) => Some(sync.clone()),
            Clocks::OfFile(_) => None,
        })
    }

    /// What should be known of the file beside the session, since this was asked last.
    pub fn take_notes(&mut self) -> Vec<SyncNote> {
        std::mem::take(&mut self.notes)
    }

    fn clocks(&mut self) -> Result<Arc<Clocks>, ReadError> {
        self.find_clocks(|_, _| {})
    }

    /// Finds the clocks, which fitting takes a while. `progress` is called with the bytes of payload read so far and those of all
    /// packets.
    ///
    /// # Errors
    /// If the file beside the session, or the session, cannot be read.
    pub fn fit_clocks(&mut self, progress: impl FnMut(u64, u64)) -> Result<(), ReadError> {
        self.find_clocks(progress).map(drop)
    }

    fn find_clocks(&mut self, progress: impl FnMut(u64, u64)) -> Result<Arc<Clocks>, ReadError> {
        if let Some(clocks) = &self.clocks {
            return Ok(clocks.clone());
        }
        let found = match &mut self.recording {
            Recording::EventFile(file) => Clocks::OfFile(file.clock()),
            Recording::Session(session) => {
                Clocks::Fitted(of_session(session, &mut |note| self.notes.push(note), progress)?)
            }
        };
        Ok(self.clocks.insert(Arc::new(found)).clone())
    }

    /// Follows the clock of an event camera's stream from its beginning.
    ///
    /// # Errors
    /// If the file beside the session, or the session, cannot be read.
    pub fn dater(&mut self, id: &str) -> Result<Dater, ReadError> {
        Ok(self.clocks()?.dater(id))
    }

    /// The exposures of a camera's frames, by the numbers of their packets.
    ///
    /// # Errors
    /// If the file beside the session, or the session, cannot be read.
    pub fn exposures(&mut self, id: &str) -> Result<HashMap<u64, Exposure>, ReadError> {
        Ok(self.clocks()?.exposures(id))
    }

    /// A decoder for the packets of a stream from a session time on, `None` for the beginning, that knows then what one knows that
    /// began at the beginning. `None` if the stream has no events, or events that erfgs does not decode.
    ///
    /// # Errors
    /// If the recording cannot be read.
    pub fn decoder(&mut self, stream: usize, from_ns: Option<i64>) -> Result<Option<BegunDecoder>, ReadError> {
        let start_ns = self.recording.summary().start.host_ns;
        Ok(match &mut self.recording {
            Recording::Session(session) => {
                session.decoder_from(stream, from_ns.map(|from_ns| from_ns.saturating_add(start_ns)))?
            }
            Recording::EventFile(file) => Some(file.decoder()),
        })
    }

    /// How many bits of the samples of a stream's frames count, where they have 16 (AEDAT 4): as said, or all.
    ///
    /// # Errors
    /// If the recording cannot be read, or leaves that open.
    pub fn bits(&mut self, stream: usize, known: Option<u8>) -> Result<u8, ReadError> {
        Ok(sample_bits(&mut self.recording, stream, known)?)
    }

    /// The events of a stream within `span_ns` of session time, its end excluded.
    ///
    /// # Errors
    /// If the stream has no events or the recording cannot be read.
    pub fn events(&mut self, id: &str, span_ns: [i64; 2], clock: EventClock) -> Result<TimedEvents, ReadError> {
        let (stream, description) = self.described(id)?;
        if !description.encoding.is_events() {
            return Err(self.lacks(id, "events", "it holds frames or lines of a trigger board"));
        }
        let whole = span_ns == ALWAYS_NS;
        let is_session = matches!(self.recording, Recording::Session(_));
        if is_session && !whole {
            return self.events_within(stream, span_ns, clock);
        }
        let mut dater = if whole && clock == EventClock::Device { None } else { Some(self.clocks()?.dater(id)) };
        let (mut found, over) = (TimedEvents::default(), Cell::new(false));
        let mut taking = Taking::of_events(dater.as_mut(), span_ns, clock, (&mut found.rows, &over));
        let decoded = match &mut self.recording {
            Recording::Session(session) => session.decode_events(stream, None, &mut taking, |_| {})?,
            Recording::EventFile(file) => Some(file.decode_events_while(&mut taking, |_| !over.get())?),
        };
        let undated = taking.undated;
        let decoded = decoded.ok_or_else(|| self.lacks(id, "events", "erfgs does not decode them"))?;
        found.damage = decoded.damage;
        found.damage.extend(feed::undated_message(id, undated, "events"));
        found.rows.sort();
        Ok(found)
    }

    /// Events of a session, from the last state of the decoder before the span on.
    fn events_within(&mut self, stream: usize, span_ns: [i64; 2], clock: EventClock) -> Result<TimedEvents, ReadError> {
        let feed = self.event_feed(stream, span_ns, clock, None)?;
        let mut follow = Follow::start(self.recording.again()?, vec![feed], span_ns);
        while !follow.has_seen(span_ns[1]) {
            follow.step()?;
        }
        let damage = follow.take_damage();
        let mut rows = follow.feeds.pop().map(|feed| feed.rows).unwrap_or_default();
        rows.sort();
        Ok(TimedEvents { rows, damage })
    }

    /// The frames of a stream whose exposures have their middles within `span_ns` of session time, its end excluded.
    ///
    /// # Errors
    /// If the stream has no frames, their depth is not told, or the recording cannot be read.
    pub fn frames(&mut self, id: &str, span_ns: [i64; 2], look: FrameLook) -> Result<Frames, ReadError> {
        let feed = self.frame_feed(id, span_ns, look)?;
        let feed = feed.ok_or_else(|| self.lacks(id, "frames", "it holds events or lines of a trigger board"))?;
        Ok(Frames::new(Follow::start(self.recording.again()?, vec![feed], span_ns), span_ns[1]))
    }

    /// What cameras saw, slice by slice.
    ///
    /// # Errors
    /// If a stream is not there or has neither events nor frames, slices have no length, or the recording cannot be read.
    pub fn slices(&mut self, options: &SliceOptions) -> Result<Slices, ReadError> {
        if options.length_ns <= 0 {
            return Err(ReadError::SliceLength { length_ns: options.length_ns });
        }
        let mut feeds = Vec::new();
        for id in self.sliced(options) {
            let (stream, description) = self.described(&id)?;
            let feed = if description.encoding.is_events() {
                let look = description.encoding.has_sensor_frames().then_some(options.look);
                Some(self.event_feed(stream, options.span_ns, EventClock::Session, look)?)
            } else {
                self.frame_feed(&id, options.span_ns, options.look)?
            };
            feeds.push(feed.ok_or_else(|| self.lacks(&id, "events or frames", "it holds lines of a trigger board"))?);
        }
        let follow = Follow::start(self.recording.again()?, feeds, options.span_ns);
        Ok(Slices::new(follow, options))
    }

    /// The streams that slices are of: those named, or all of cameras.
    fn sliced(&self, options: &SliceOptions) -> Vec<String> {
        let all = self.recording.summary().streams.iter().map(|stream| &stream.description);
        let cameras = all.filter(|all| all.encoding.is_events() || all.encoding.is_frames());
        options.streams.clone().unwrap_or_else(|| cameras.map(|camera| camera.id.clone()).collect())
    }

    fn event_feed(
        &mut self,
        stream: usize,
        span_ns: [i64; 2],
        clock: EventClock,
        frames: Option<FrameLook>,
    ) -> Result<Feed, ReadError> {
        let id = self.recording.summary().streams[stream].description.id.clone();
        let dater = self.clocks()?.dater(&id);
        let frames = match frames {
            Some(look) => Some(FrameLook { bits: Some(self.bits(stream, look.bits)?), ..look }),
            None => None,
        };
        let from_ns = (span_ns[0] != i64::MIN).then(|| span_ns[0].saturating_sub(SLACK_NS));
        let begun = self.decoder(stream, from_ns)?;
        let begun = begun.ok_or_else(|| self.lacks(&id, "events", "erfgs does not decode them"))?;
        Ok(Feed::of_events(stream, id, begun, dater, (span_ns, clock, frames)))
    }

    /// `None` where the stream has no frames.
    fn frame_feed(&mut self, id: &str, span_ns: [i64; 2], look: FrameLook) -> Result<Option<Feed>, ReadError> {
        let (stream, description) = self.described(id)?;
        if description.encoding.has_sensor_frames() {
            return self
                .event_feed(stream, span_ns, EventClock::Session, Some(look))
                .map(|feed| Some(feed.of_frames()));
        }
        let Some(format) = description.frame_format() else { return Ok(None) };
        let exposures = self.clocks()?.exposures(id);
        Ok(Some(Feed::of_camera(stream, &description, format, exposures, (span_ns, look.depth.is_deep(format.pixels)))))
    }

    fn described(&self, id: &str) -> Result<(usize, Description), ReadError> {
        let (stream, Stream { description, .. }) = self.recording.stream(id)?;
        Ok((stream, description.clone()))
    }

    fn lacks(&self, id: &str, what: &'static str, why: &'static str) -> ReadError {
        ReadError::Lacks { path: self.recording.path().to_owned(), id: id.to_owned(), what, why }
    }
}

/// When to have read all that was seen before a session time, by the arrival of packets.
fn arrived_after(t_ns: i64) -> i64 {
    t_ns.saturating_add(LATE_NS)
}
