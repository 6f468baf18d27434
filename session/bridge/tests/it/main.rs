//! What the bridge writes, read by the libraries of others, which `scripts/setup.sh --oracles` installs; and what it makes of files.

mod foxglove;
mod import;
mod oracle;
mod recorded;
mod rosbag2;
