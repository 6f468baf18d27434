//! Recorded sessions as live sources.
//!
//! A [`Player`] opens a session and hands out one [`Source`] for each of its streams. Once all of them are started, one
//! thread reads the file and sends every packet when its time has come. To whoever receives them they look like those of
//! devices:
//!
//! - Host times and the kernel's stamps are moved so that the session starts now. They run at the rate of the recording,
//!   whatever the speed of the playback, so that clocks fit as they did.
//! - Sequence numbers go on when the session starts over, and so does time; the first packets after a start at a later
//!   time, a jump or a new round are marked as discontinuous.
//! - An outlet that has no room loses the packet, as it would with a device; only at [`Speed::Max`], where nothing else
//!   paces the playback, the player waits and offers it again.

mod conductor;
mod control;
#[cfg(test)]
mod tests;

use std::{
    path::{Path, PathBuf},
    sync::{Arc, PoisonError},
    thread::JoinHandle,
};

use erfgs_events::EventFileHints;
use erfgs_session::{
    container::{ContainerError, Recording, Summary},
    source::{Counters, Description, Outlet, Source, SourceError},
};

pub use control::{Controls, Speed};
use control::{Seat, Shared};

/// How a session is played.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlayerOptions {
    /// How fast.
    pub speed: Speed,
    /// Whether to start over at the end.
    pub repeat: bool,
    /// Where to start, nanoseconds of session time.
    pub seek_ns: i64,
    /// What the user says of an event file.
    pub hints: EventFileHints,
}

/// A recording that is open for playing.
pub struct Player {
    summary: Summary,
    shared: Arc<Shared>,
}

impl Player {
    /// Opens a session, a recording of ROS 2 or an event file.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn open(path: &Path, options: PlayerOptions) -> Result<Self, ContainerError> {
        let summary = Recording::open_with(path, &options.hints)?.summary().clone();
        let shared = Arc::new(Shared::new(path.to_owned(), options, summary.streams.len()));
        Ok(Self { summary, shared })
    }

    /// What the session holds.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// The streams as sources, in the order of the session. They play once all are started; those that are dropped are
    /// not waited for.
    #[must_use]
    pub fn sources(&self) -> Vec<PlayedSource> {
        let streams = self.summary.streams.iter().enumerate();
        streams
            .map(|(stream, recorded)| PlayedSource {
                description: recorded.description.clone(),
                stream,
                shared: self.shared.clone(),
            })
            .collect()
    }

    /// A handle to steer the playback with, from any thread.
    #[must_use]
    pub fn controls(&self) -> Controls {
        Controls::new(self.shared.clone(), self.summary.start.host_ns)
    }
}

/// A stream of a session, as a source.
pub struct PlayedSource {
    description: Description,
    stream: usize,
    shared: Arc<Shared>,
}

impl Source for PlayedSource {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        self.shared.set(self.stream, Seat::Started(outlet));
        if self.shared.all_started() {
            let mut conductor = self.shared.conductor.lock().unwrap_or_else(PoisonError::into_inner);
            if conductor.as_ref().is_none_or(JoinHandle::is_finished) {
                let recording = Recording::open_with(&self.shared.path, &self.shared.orders().options.hints)?;
                let shared = self.shared.clone();
                let thread = std::thread::Builder::new().name("erfgs-replay".into());
                *conductor = Some(thread.spawn(move || conductor::conduct(recording, &shared))?);
            }
        }
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.shared.set(self.stream, Seat::Stopped);
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.shared.counters(self.stream)
    }

    fn readings(&mut self) -> Vec<(String, f64)> {
        self.shared.readings(&self.description.id)
    }
}

impl Drop for PlayedSource {
    fn drop(&mut self) {
        self.shared.set(self.stream, Seat::Gone);
    }
}

/// The file that a player plays; for messages.
impl std::fmt::Debug for Player {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let path: &PathBuf = &self.shared.path;
        f.debug_struct("Player").field("path", path).finish_non_exhaustive()
    }
}
