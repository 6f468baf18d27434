//! The session file: one MCAP file with everything that a rig delivered, byte for byte.
//!
//! `docs/reference/session.md` describes the format for readers that are not this program.
//!
//! The files here are the forms that all of it shares. `foreign` stands on these, `read` on `foreign`, `write` and `repair` on
//! `read`; no arrow goes back.

mod decoded;
mod entry;
mod error;
mod foreign;
pub mod packet;
mod parts;
mod read;
mod record;
mod repair;
mod summary;
mod whole;
mod write;

pub use decoded::{BegunDecoder, DecodedStream};
pub use entry::{DecoderState, Entry, Stream};
pub use error::ContainerError;
pub use foreign::{EventFileRecording, HostClock, bag::recording_file};
pub use parts::{MAX_PART, PartOf, SessionId, part_path, parts_beside};
pub use read::{IntoMessages, Messages, Recording, Session, hand_over, sensor_size};
pub use record::{IncidentEntry, SessionStart, Status, StreamStatus, StreamTotals, Totals, plain_id};
pub use repair::{Recovered, recover, recover_in_place};
pub use summary::{FileSummary, Summary};
pub use write::{
    Finished, Merged, MergedStream, NextPart, Part, SessionWriter, Settings, Split, SplitError, StreamId,
    import_events, merge, write_excerpt,
};
