//! The rig: drivers of event cameras, RGB cameras and the trigger board, their common clock, and the recorder.
//!
//! Every driver is an [`erfgs_session::source::Source`]; the recorder knows nothing else of a device.

pub mod event;
pub mod frame;
pub mod host_time;
pub mod live;
mod not_applied;
pub mod record;
pub mod sync;
pub mod trigger;
pub mod usb;
