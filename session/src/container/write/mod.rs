//! Writing: a session while it is recorded, in one file or several, from an event file, of a range of a recording, and of several hosts as one.

mod excerpt;
mod import_events;
mod merge;
mod output;
mod split;
mod states;
mod writer;

pub use self::{
    excerpt::write_excerpt,
    import_events::import_events,
    merge::{Merged, MergedStream, Part, merge},
    split::{Split, SplitError},
    writer::{Finished, NextPart, SessionWriter, Settings, StreamId},
};
