//! The host's clock: every arrival is stamped with it, and every device clock is fitted to it.

/// `CLOCK_MONOTONIC`, nanoseconds: the clock of [`Packet::host_ns`](erfgs_session::source::Packet::host_ns), and the
/// one that V4L2 stamps frames with.
#[cfg(unix)]
#[must_use]
pub fn host_ns() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

/// Nanoseconds of a clock that never steps, from an arbitrary moment of this process.
#[cfg(not(unix))]
#[must_use]
pub fn host_ns() -> i64 {
    use std::{sync::OnceLock, time::Instant};
    static EPOCH: OnceLock<Instant> = OnceLock::new();
    i64::try_from(EPOCH.get_or_init(Instant::now).elapsed().as_nanos()).unwrap_or(i64::MAX)
}
