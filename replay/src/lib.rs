//! Recorded sessions as live streams, the event simulator, and the dataset variants.
//!
//! - [`simulator`]: events from frames, by v2e's pixel model (`parity`) or a finer one (`enhanced`).
//! - [`variant`]: temporal subsampling, motion blur and disjoint viewpoints made from a dataset, with simulated events.
//! - [`player`]: recorded sessions as live sources.
//! - [`mod@bench`]: the simulator's speed.

pub mod bench;
pub mod player;
pub mod simulator;
pub mod variant;

pub use player::{Controls, PlayedSource, Player, PlayerOptions, Speed};
pub use simulator::{Luma, Mode, Simulator, SimulatorConfig, SimulatorError};
pub use variant::{VariantError, VariantOptions};
