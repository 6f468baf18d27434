//! Sessions whose clocks break, run freely, or are told by a flash, and exposures by pulses.

mod breaks;
mod camera_clock;
mod exposures;
mod flash;
mod merge;
mod reading;
mod strobe;
