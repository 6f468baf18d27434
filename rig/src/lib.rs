//! The rig: drivers of event cameras, RGB cameras and the trigger board.
//!
//! Every driver is an [`erfgs_session::source::Source`]; who takes its packets knows nothing else of a device.

pub mod event;
pub mod frame;
pub mod host_time;
mod not_applied;
pub mod trigger;
pub mod usb;
