//! Sessions through the program: recorded, written, cut off, repaired, described, exported, replayed, synchronised; event files of other
//! programs, and what is said of wrong input.

mod biases;
#[cfg(target_os = "linux")]
#[path = "../../rig/tests/it/usb_cameras/support/bus.rs"]
mod bus;
mod chain;
mod damage;
pub mod dataset;
mod event_files;
mod excerpt;
mod faults;
mod files;
mod film;
#[cfg(target_os = "linux")]
mod gige;
#[cfg(target_os = "linux")]
#[path = "../../rig/tests/it/usb_cameras/support/host_clock.rs"]
mod host_clock;
mod hosts;
mod live;
mod merge;
mod names;
#[cfg(target_os = "linux")]
mod no_room;
mod plan;
mod raw;
mod rig;
#[cfg(target_os = "linux")]
mod selftest;
mod session;
mod split;
mod told;
mod tools;
#[cfg(target_os = "linux")]
mod u3v;
