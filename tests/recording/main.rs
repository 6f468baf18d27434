//! Sessions through the program: written, cut off, repaired, described, exported, replayed, synchronised.

mod files;
mod session;
