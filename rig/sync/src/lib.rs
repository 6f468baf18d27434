//! One clock for all streams of a session.
//!
//! The session clock is the host's. The trigger board's clock is tied to it by the arrival of the board's lines and by
//! its answers to `clock` commands; event cameras that see the board's pulses are tied to the board by their edges, which
//! the code on the pulses numbers; frames belong to the pulses that triggered them. What the board's own clock may be off
//! is common to all of them, so that they agree with one another far better than with the host.
//!
//! Four tiers are declared for each stream ([`Tier`]): a strobe that an event camera sees, hardware-triggered, free-running
//! with arrival or kernel stamps, and free-running with a lag that a flash told.

mod board;
mod camera_clock;
mod collect;
mod edges;
mod epochs;
mod even;
mod events;
mod exposures;
mod flash;
mod frames;
mod jumps;
mod kept;
mod lamp;
mod plot;
mod pulses;
pub mod reading;
mod report;
mod streams;
mod strobe;
mod table;
#[cfg(test)]
mod tests;

pub use board::{Board, BoardLines, Bounds, NS_PER_TICK as BOARD_NS_PER_TICK};
pub use collect::{SyncOptions, synchronise};
pub use edges::{Matched, WINDOW_NS as EDGES_WINDOW_NS, fit as fit_edges, fit_arrivals, pulses};
pub use even::{Even, even, median};
pub use exposures::Exposures;
pub use flash::{FlashLag, find_lag, lit_intervals};
pub use frames::{Arrived, free_running, lagging, match_pulses};
pub use kept::{SyncError, SyncNote, kept, of_session};
pub use plot::page;
pub use pulses::{AlignError, Aligned, Pulses};
pub use report::{StreamSync, SyncFileError, Synchronisation, Tier};
pub use strobe::is_strobe;
pub use table::Row;
