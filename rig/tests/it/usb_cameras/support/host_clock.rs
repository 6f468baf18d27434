//! The clock of this machine.

use std::{thread, time::Duration};

use erfgs_rig::host_time::host_ns;

use super::bus::Clock;

pub struct HostClock;

impl Clock for HostClock {
    fn now_ns(&self) -> i64 {
        host_ns()
    }

    fn pass(&self, duration: Duration) {
        thread::sleep(duration);
    }
}
