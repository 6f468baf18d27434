//! Emulated devices, and the stage that they film.

pub mod stage;
pub mod usb;
