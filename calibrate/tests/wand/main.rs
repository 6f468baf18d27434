//! Calibration by wand: rigs that are simulated, and one that was recorded.

mod ewand;
