//! The recorders of other hosts: more cameras than one computer takes, and one trigger board.
//!
//! The host that leads starts, stops and watches the others over what their live pages use: the same addresses, the same token.
//! It starts them first and itself last, so that all are there when its trigger board begins; what ends its own recording ends
//! theirs. A host that is lost costs its own streams: the others go on, and so does it, until its disk is full or somebody stops
//! it there.

mod bounded;
mod client;
mod error;
mod group;
mod host;
mod link;
mod merge;
mod report;

pub use error::{HostError, LinkError, StartError};
pub use group::Hosts;
pub use host::{HostEnd, HostTake};
pub use link::HostLink;
pub use merge::merge_commands;
pub use report::HostView;
