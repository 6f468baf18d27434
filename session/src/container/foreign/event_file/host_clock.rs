//! The host's clock, had the file been recorded: it goes with the device's, and never back.

/// Host time of the device times of an event file, in the order of the file.
#[derive(Clone, Copy, Debug, Default)]
pub struct HostClock {
    first_us: u64,
    /// What is added to device times since the device's clock was set back.
    offset_us: u64,
    last_us: u64,
}

impl HostClock {
    /// Device time `first_us` is host time 0.
    #[must_use]
    pub fn new(first_us: u64) -> Self {
        Self { first_us, ..Self::default() }
    }

    /// The host time at which an item of device time `t_us` is there, nanoseconds.
    pub fn host_ns(&mut self, t_us: u64) -> i64 {
        self.last_us = self.last_us.max(t_us.saturating_add(self.offset_us).saturating_sub(self.first_us));
        self.last_ns()
    }

    /// The last host time, nanoseconds.
    #[must_use]
    pub fn last_ns(&self) -> i64 {
        i64::try_from(self.last_us).unwrap_or(i64::MAX).saturating_mul(1000)
    }

    /// The device's clock goes on from `t_us`.
    pub fn discontinuity(&mut self, t_us: u64) {
        let now = t_us.saturating_add(self.offset_us).saturating_sub(self.first_us);
        self.offset_us = self.offset_us.saturating_add(self.last_us.saturating_sub(now));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_stands_still_where_times_go_back_and_goes_on_where_the_device_was_reset() {
        let mut clock = HostClock::new(1000);
        assert_eq!([1000, 1500, 1400, 1600].map(|t_us| clock.host_ns(t_us)), [0, 500_000, 500_000, 600_000]);
        clock.discontinuity(0);
        assert_eq!(clock.host_ns(7), 600_000);
        clock.discontinuity(2000);
        assert!(clock.host_ns(2000) > 600_000);
    }
}
