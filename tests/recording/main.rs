//! Sessions through the program: recorded, written, cut off, repaired, described, exported, replayed, synchronised.

mod files;
mod live;
mod rig;
mod session;
