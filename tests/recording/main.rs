//! Sessions through the program: recorded, written, cut off, repaired, described, exported, replayed, synchronised.

mod dataset;
mod files;
mod live;
mod raw;
mod rig;
mod session;
