//! A playback that the page steers, where a recording is played instead of a rig.

use serde::{Deserialize, Serialize};

/// Where a playback is.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlaybackStatus {
    /// Session time that is played, nanoseconds.
    pub position_ns: i64,
    /// Session time of the end, nanoseconds.
    pub length_ns: i64,
    /// When the recording began, nanoseconds since 1970; 0 where nobody knows.
    pub epoch_ns: i64,
    /// Whether it is halted.
    pub paused: bool,
    /// Whether the end was reached.
    pub finished: bool,
    /// Whether it starts over at the end.
    pub repeat: bool,
    /// How many times as fast as it was recorded; absent: as fast as it goes.
    pub speed: Option<f64>,
    /// The streams that have frames.
    pub cameras: Vec<String>,
}

/// What the page can ask for.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum PlaybackOrder {
    /// Halt.
    Pause,
    /// Go on; from the beginning where the end was reached.
    Play,
    /// Jump to this session time, nanoseconds.
    Seek(i64),
    /// Halt, and go so many nanoseconds further, or back.
    Step(i64),
    /// Halt, and go one frame of this camera further; the name of the first one is meant where it is empty.
    Frame(String),
    /// Halt, and go one frame of this camera back.
    FrameBack(String),
    /// Play so many times as fast as it was recorded.
    Speed(f64),
}

/// A playback. Is called by the threads of the page, and must return at once.
pub trait Playback: Send + Sync {
    /// Where it is.
    fn status(&self) -> PlaybackStatus;

    /// Does what the page asks for.
    ///
    /// # Errors
    /// Why it cannot, for the user.
    fn order(&self, order: &PlaybackOrder) -> Result<(), String>;
}
