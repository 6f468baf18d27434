//! The session file: one MCAP file with everything that a rig delivered, byte for byte.
//!
//! `docs/reference/session.md` describes the format for readers that are not this program.

mod bag;
mod chunk;
mod decode;
mod error;
mod event_file;
mod excerpt;
mod framing;
mod layout;
mod mend;
mod merge;
mod messages;
pub mod packet;
mod packet_log;
mod parse;
mod record;
mod recording;
mod repair;
mod resync;
mod ros;
#[cfg(feature = "rosbag2")]
mod rosbag2;
mod said;
mod session;
mod states;
mod survey;
mod tail;
mod unpack;
mod walk;
mod writer;

pub use bag::recording_file;
pub use decode::{BegunDecoder, DecodedStream, hand_over, sensor_size};
pub use error::ContainerError;
pub use event_file::{EventFileRecording, HostClock, import_events};
pub use excerpt::write_excerpt;
pub use layout::{DecoderState, Entry, Stream};
pub use merge::{Merged, MergedStream, Part, merge};
pub use messages::{IntoMessages, Messages};
pub use record::{IncidentEntry, SessionStart, Status, StreamStatus, StreamTotals, Totals};
pub use recording::Recording;
pub use repair::{Recovered, recover, recover_in_place};
pub use session::{Session, Summary};
pub use writer::{Finished, SessionWriter, Settings, StreamId};
