//! Sessions for the tools that people have, and sessions of files that they have: a recording as messages of [Foxglove](https://foxglove.dev), which Rerun reads, too, and as
//! a bag of ROS 2.
//!
//! What is written has the session's one clock ([`erfgs_sync`]) as time since 1970, and where a rig file is given, the cameras' lenses
//! and poses. `docs/guide/other-tools.md` says which topics there are and what they hold. Recordings are read and written piece by piece.
//! The other way, [`import`] makes one session of the files of several cameras.

mod cdr;
mod error;
pub mod foxglove;
pub mod import;
mod log;
mod protobuf;
mod rig;
pub mod rosbag2;

use erfgs_session::source::Description;
use erfgs_sync::reading::TimedRecording;

pub use error::BridgeError;
pub use log::WrittenTopic;

/// What became of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// The topics, in the order of their first messages.
    pub topics: Vec<WrittenTopic>,
    /// What the user should know, a sentence each.
    pub notes: Vec<String>,
    /// What of the recording was passed over, a sentence each.
    pub damage: Vec<String>,
}

/// The streams that are written: those that are named, or all of cameras.
fn described(recording: &TimedRecording, named: Option<&[String]>) -> Result<Vec<Description>, BridgeError> {
    let recording = recording.recording();
    let Some(named) = named else {
        let all = recording.summary().streams.iter().map(|stream| &stream.description);
        return Ok(all.filter(|stream| stream.encoding.is_events() || stream.encoding.is_frames()).cloned().collect());
    };
    named.iter().map(|id| Ok(recording.stream(id)?.1.description.clone())).collect()
}
