//! The live page: every camera's preview, rates, drops and clocks, the disk, start and stop, in a browser.
//!
//! [`Monitor`] looks at packets as they pass, on one thread with a bounded share of a core, and may miss any of them:
//! what it shows says how much it saw. [`LivePage`] serves it over HTTP, to this machine alone unless told otherwise.

mod clock;
mod eye;
mod frames;
mod guide;
mod monitor;
mod picture;
mod playback;
mod routes;
mod server;

pub use crate::names::{NameError, RecordingFile, recordings};
pub use erfgs_page::serve::{PageError, PageOptions};
pub use guide::{Guidance, Guide};
pub use monitor::{Look, Monitor, MonitorOptions};
pub use playback::{Playback, PlaybackOrder, PlaybackStatus};
pub use server::LivePage;
