//! What other programs write: event files, and recordings of ROS 2.

pub(super) mod bag;
mod event_file;
pub(super) mod ros;
#[cfg(feature = "rosbag2")]
pub(super) mod rosbag2;

pub use self::event_file::{EventFileRecording, HostClock};
