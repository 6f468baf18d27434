//! The session file, against the reader of the `mcap` crate and against damage.

mod common;
mod compressed;
mod event_file;
mod excerpt;
mod faults;
#[cfg(feature = "export")]
mod frames;
#[cfg(feature = "hdf5")]
mod hdf5;
mod parts;
mod read;
mod recover;
mod ros;
mod ros_variants;
#[cfg(feature = "rosbag2")]
mod rosbag2;
mod write;
