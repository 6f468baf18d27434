//! The recorder under faults: slow, full and failing disks, devices that stall, vanish, refuse and flood.

mod faults;
mod order;
mod support;
