//! Sessions through the program: recorded, written, cut off, repaired, described, exported, replayed, synchronised.

mod files;
mod rig;
mod session;
