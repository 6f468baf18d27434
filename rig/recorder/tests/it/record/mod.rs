//! The recorder under faults: slow, full and failing disks, devices that stall, vanish, refuse and flood.

mod adjusted;
#[path = "../../../../tests/it/usb_cameras/support/bus.rs"]
mod bus;
#[path = "../../../../tests/it/usb_cameras/support/clock.rs"]
mod clock;
mod faults;
mod order;
mod past;
mod split;
mod support;
