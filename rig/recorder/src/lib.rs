//! The recorder: from sources through bounded queues into one session, in one file or several.
//!
//! ```text
//! source ─► outlet ─► queue (bounded bytes a stream) ─► writer thread ─► session file
//!             └─────► subscriber (previews, event rates)     watchdog thread: stalls, drops, disk, status
//! ```
//!
//! Nothing blocks a device: what finds no room is dropped and counted at its stage, and the next packet of the stream
//! is marked as following a gap. A session file is readable whenever the process ends, however it ends.

mod adjust;
mod alarm;
mod concerns;
mod config;
mod error;
mod files;
mod gate;
mod host;
pub mod hosts;
pub mod live;
mod log;
mod meter;
mod names;
mod pattern;
pub mod preflight;
mod queue;
mod recorder;
mod rig;
mod rig_file;
mod session_file;
mod sink;
mod status;
mod stream_outlet;
mod stream_queue;
mod subscriber;
mod watchdog;
mod writer;

pub use adjust::AdjustError;
pub use alarm::{Alarm, AlarmKind};
pub use config::{ConfigError, DeviceConfig, DeviceSettings, RecordConfig, RigConfig};
pub use error::RecordError;
pub use gate::Before;
pub use host::{DiskSpace, disk_space, folder_of};
pub use pattern::{Pattern, PatternConfig, PatternKind};
pub use recorder::{Input, Options, Recorder, is_id};
pub use rig::{OpenError, open, open_on};
pub use rig_file::keep_settings;
pub use session_file::{MachineFacts, SessionFiles};
pub use sink::{OpenSession, SessionInfo, SessionSink, SinkError};
pub use status::{
    ClockStatus, DiskStatus, HeldStatus, Level, Message, RecordingStatus, Status, StreamState, StreamStatus, Summary,
};
pub use stream_queue::Drops;
pub use subscriber::Subscriber;
