//! What the bridge writes, read by the libraries of others, which `scripts/setup.sh --oracles` installs.

mod foxglove;
mod oracle;
mod recorded;
mod rosbag2;
