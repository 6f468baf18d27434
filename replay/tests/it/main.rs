//! The simulator against v2e and against what is known exactly, and the variants.

mod simulator;
mod v2e;
mod variant;
