//! Front ends: how transfers reach the devices from outside this process.

pub mod usbip;
pub mod vhci;

/// The time that front ends give to devices: `CLOCK_MONOTONIC`, nanoseconds. Recorders stamp with the same clock, so that
/// the times that a model knows as true can be compared with theirs.
#[must_use]
pub fn monotonic_ns() -> i64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}
