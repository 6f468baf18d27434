//! Files of other programs, read and written, side by side with those programs; pictures of raw frames.

mod colmap;
mod demosaic;
mod exchange;
mod plausible;
