//! Emulated rigs test themselves: a sound one without a complaint, and each fault of the emulated devices by its name.
#![cfg(target_os = "linux")]

#[path = "../../../tests/it/usb_cameras/support/bus.rs"]
mod bus;

mod boards;
mod ethernet;
mod event_cameras;
mod report;
mod rig;
mod simulated;
mod sound;
mod usb_frames;
