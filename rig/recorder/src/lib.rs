//! The recorder: from sources through bounded queues into one session file.
//!
//! ```text
//! source ─► port ─► queue (bounded bytes a stream) ─► writer thread ─► session file
//!             └───► tap (previews, event rates)          steward: stalls, drops, disk, status
//! ```
//!
//! Nothing blocks a device: what finds no room is dropped and counted at its stage, and the next packet of the stream
//! is marked as following a gap. A session file is readable whenever the process ends, however it ends.

mod config;
mod error;
mod host;
mod lane;
pub mod live;
mod log;
mod mcap;
mod meter;
mod pattern;
mod port;
pub mod preflight;
mod queue;
mod recorder;
mod rig;
mod sink;
mod status;
mod steward;
mod writer;

pub use config::{ConfigError, DeviceConfig, DeviceSettings, RecordConfig, RigConfig};
pub use error::RecordError;
pub use host::{DiskSpace, disk_space, folder_of};
pub use lane::Drops;
pub use mcap::{MachineFacts, Mcap};
pub use pattern::{Pattern, PatternConfig, PatternKind};
pub use port::Tap;
pub use recorder::{Input, Options, Recorder, is_id};
pub use rig::{OpenError, open, open_on};
pub use sink::{OpenSession, SessionInfo, SessionSink, SinkError};
pub use status::{
    ClockLine, ClockStatus, DiskStatus, Level, Message, RecordingStatus, Status, StreamState, StreamStatus, Summary,
};
