//! What synchronisation found, and the file beside the session that keeps it.

use std::{
    collections::HashMap,
    io,
    path::{Path, PathBuf},
};

use erfgs_base::plausible::{EXPOSURE, INSTANT, Implausible, OFFSET, TICK};
use erfgs_session::clock::{Clock, Epochs, Evidence, Exposure};
use serde::{Deserialize, Serialize};

use super::{edges::Matched, exposures::Exposures};

/// Version of the file.
pub const VERSION: u32 = 2;

/// How well a stream is tied to the session clock, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tier {
    /// An event camera sees the camera's strobe: both ends of each exposure. Of an event camera: it sees one.
    Strobe,
    /// The trigger board drives the stream, or the stream saw its pulses. Without a board: pulses that trigger a camera and that
    /// an event camera saw.
    HardwareTriggered,
    /// The stream runs freely; a flash that it saw tells its lag.
    Flash,
    /// The stream runs freely: what is known is when its data arrived, or when the kernel stamped it.
    FreeRunning,
}

impl Tier {
    /// Of an event camera's clock.
    #[must_use]
    pub fn of(clock: &Clock) -> Self {
        match clock.evidence() {
            Some(Evidence::TriggerEdges) => Self::HardwareTriggered,
            Some(Evidence::Flash) => Self::Flash,
            Some(Evidence::Arrival | Evidence::KernelStamps) | None => Self::FreeRunning,
        }
    }

    /// As the tables name it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Strobe => "S, strobe",
            Self::HardwareTriggered => "A, hardware-triggered",
            Self::FreeRunning => "B, free-running",
            Self::Flash => "C, free-running with a flash",
        }
    }
}

/// One stream on the session clock.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamSync {
    /// The stream.
    pub id: String,
    /// How it is tied to the session clock: the worst of its epochs.
    pub tier: Tier,
    /// From its ticks to session time, for each stretch in which its device's clock ran without a break; none for frames,
    /// which have no ticks of their own.
    #[serde(default, skip_serializing_if = "no_epochs")]
    pub epochs: Epochs,
    /// How its edges matched the board's pulses, all epochs together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matched: Option<Matched>,
    /// Its frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposures: Option<Exposures>,
    /// What is not as it should be: what was lost, and what cannot be relied on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<String>,
    /// What else the user should know.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Points for the plot: session time in seconds, distance in nanoseconds.
    #[serde(skip)]
    pub points: Vec<(f64, f64)>,
}

fn no_epochs(epochs: &Epochs) -> bool {
    epochs.as_slice().is_empty()
}

/// All streams of a session on its clock.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Synchronisation {
    /// Version of the file.
    pub version: u32,
    /// Name of the session's file.
    pub session: String,
    /// The streams, in the order of the session.
    pub streams: Vec<StreamSync>,
}

/// Why the file of a synchronisation cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SyncFileError {
    /// It cannot be read.
    #[error("cannot read {path}: {source}; `erfgs sync` writes it anew", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It cannot be written.
    #[error("cannot write {path}: {source}; give another place with --out", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It is no such file, or of a version that this program does not know.
    #[error("{path} is not a synchronisation that this program knows: {what}; `erfgs sync` writes it anew", path = path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
}

impl StreamSync {
    /// The exposure of each frame, by the frame's number; none where the stream has no frames.
    #[must_use]
    pub fn frames(&self) -> HashMap<u64, Exposure> {
        self.exposures.as_ref().map(Exposures::by_sequence).unwrap_or_default()
    }
}

impl StreamSync {
    /// Whether clocks and exposures can be those of a recording.
    fn check(&self) -> Result<(), Implausible> {
        for line in self.epochs.clocks().flat_map(|clock| &clock.pieces) {
            TICK.check(line.ns_per_tick)?;
            INSTANT.check_ns(line.origin_ns)?;
        }
        let Some(exposures) = &self.exposures else { return Ok(()) };
        INSTANT.check_all_ns(exposures.mid_ns.iter().copied())?;
        EXPOSURE.check_all_ns(exposures.exposure_ns.iter().copied())?;
        OFFSET.check_ns(exposures.lag_ns).map(drop)
    }
}

impl Synchronisation {
    /// Where the synchronisation of a session lies: `a.sync.json` beside `a.mcap`.
    #[must_use]
    pub fn file_beside(session: &Path) -> PathBuf {
        session.with_extension("sync.json")
    }

    /// The stream of this name.
    #[must_use]
    pub fn stream(&self, id: &str) -> Option<&StreamSync> {
        self.streams.iter().find(|stream| stream.id == id)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is of another kind or version, or holds times that make no sense.
    pub fn load(path: &Path) -> Result<Self, SyncFileError> {
        let bytes = std::fs::read(path).map_err(|source| SyncFileError::Read { path: path.to_owned(), source })?;
        let content = |what: String| SyncFileError::Content { path: path.to_owned(), what };
        let found: Self = serde_json::from_slice(&bytes).map_err(|error| content(error.to_string()))?;
        if found.version != VERSION {
            return Err(content(format!("its version is {}, known is {VERSION}", found.version)));
        }
        for stream in &found.streams {
            stream.check().map_err(|wrong| content(format!("stream {}: {wrong}", stream.id)))?;
        }
        Ok(found)
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), SyncFileError> {
        let failed = |source| SyncFileError::Write { path: path.to_owned(), source };
        let bytes = serde_json::to_vec(self).map_err(|error| failed(error.into()))?;
        erfgs_base::atomic::write(path, &bytes).map_err(failed)
    }
}

#[cfg(test)]
mod tests {
    use erfgs_session::clock::{ClockFit, Residuals};
    use proptest::prelude::*;

    use super::*;

    fn with(origin_ns: i64, ns_per_tick: f64, [mid_ns, length_ns, lag_ns]: [i64; 3]) -> Synchronisation {
        let fit = ClockFit {
            evidence: Evidence::Arrival,
            origin_ticks: 5,
            origin_ns,
            ns_per_tick,
            window_ticks: [0, 9],
            residuals: Residuals::default(),
            samples: 3,
            outliers: 0,
        };
        let exposures = Exposures {
            sequence: vec![1],
            mid_ns: vec![mid_ns],
            exposure_ns: vec![length_ns],
            lag_ns,
            ..Exposures::default()
        };
        let stream = StreamSync {
            id: "left".into(),
            tier: Tier::FreeRunning,
            epochs: Clock::line(fit, 1000.0).into(),
            matched: None,
            exposures: Some(exposures),
            faults: Vec::new(),
            notes: Vec::new(),
            points: Vec::new(),
        };
        Synchronisation { version: VERSION, session: "a.mcap".into(), streams: vec![stream] }
    }

    fn through(sync: &Synchronisation) -> Result<Synchronisation, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.sync.json");
        sync.save(&path).unwrap();
        Synchronisation::load(&path).map_err(|error| error.to_string())
    }

    proptest! {
        #[test]
        fn times_of_recordings_come_back_and_others_are_refused_with_their_stream(
            at in -4_000_000_000_000_000_000..4_000_000_000_000_000_000_i64,
            length in 0..600_000_000_000_i64,
            tick in 0.01..1e8_f64,
            beyond in 4_100_000_000_000_000_000..i64::MAX,
        ) {
            let good = with(at, tick, [at, length, length / 2]);
            prop_assert_eq!(through(&good), Ok(good));
            for (wrong, quantity) in [
                (with(beyond, tick, [at, length, 0]), "a time"),
                (with(-beyond, tick, [at, length, 0]), "a time"),
                (with(at, 0.0, [at, length, 0]), "a tick"),
                (with(at, -tick, [at, length, 0]), "a tick"),
                (with(at, 1e300, [at, length, 0]), "a tick"),
                (with(at, tick, [beyond, length, 0]), "a time"),
                (with(at, tick, [at, 9_007_199_254_740_992, 0]), "an exposure"),
                (with(at, tick, [at, -1, 0]), "an exposure"),
                (with(at, tick, [at, length, beyond]), "a time offset"),
            ] {
                let message = through(&wrong).unwrap_err();
                let named = message.contains("a.sync.json") && message.contains("stream left") && message.contains(quantity);
                prop_assert!(named && message.contains("plausible"), "{}", message);
            }
        }
    }
}
