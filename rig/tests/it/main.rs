//! Drivers against emulated devices, and against what is plugged into this machine.

#[cfg(target_os = "linux")]
mod frame_cameras;
mod gige;
mod kept;
mod libusb;
#[cfg(target_os = "linux")]
mod strobe;
#[cfg(unix)]
mod trigger_board;
#[cfg(target_os = "linux")]
mod u3v;
mod usb_cameras;
