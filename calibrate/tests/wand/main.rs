//! Calibration by wand: rigs that are simulated, and one that was recorded.

mod accuracy;
mod ewand;
mod extreme;
mod frame;
mod refusals;
mod rig;
mod time;
