//! Emulated devices, and the stage that they film.

mod genicam;
#[cfg(unix)]
pub mod gige;
#[cfg(unix)]
pub mod trigger;
pub mod usb;
#[cfg(target_os = "linux")]
pub mod v4l2;
