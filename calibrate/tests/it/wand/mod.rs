//! Calibration by wand: rigs that are simulated, and one that was recorded.

mod accuracy;
mod dome;
mod ewand;
mod extreme;
mod known_rig;
mod panoptic;
mod refusals;
mod rig;
mod session;
mod time;
