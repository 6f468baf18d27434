//! The clocks of sensors: crystals that are off and drift, and a wire over which one sensor clocks others.

use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};

/// How far a crystal is from its nominal rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockError {
    /// Offset at power-on, parts per million; positive: the device's clock is fast.
    pub offset_ppm: f64,
    /// Change of the offset, parts per million per minute.
    pub drift_ppm_per_min: f64,
    /// When the count jumps, seconds after power-on.
    pub jump_at_s: f64,
    /// By how much it jumps then, microseconds; positive: ahead.
    pub jump_us: f64,
}

/// A crystal that has run since power-on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crystal {
    error: ClockError,
    powered_ns: i64,
}

impl Crystal {
    /// A crystal that starts at `powered_ns` of true time.
    #[must_use]
    pub fn new(error: ClockError, powered_ns: i64) -> Self {
        Self { error, powered_ns }
    }

    /// What the crystal counts from power-on to the true time `now_ns`, nanoseconds.
    #[must_use]
    pub fn elapsed_ns(&self, now_ns: i64) -> i64 {
        let true_ns = now_ns - self.powered_ns;
        let tau = true_ns as f64;
        let per_ns = self.error.drift_ppm_per_min * 1e-6 / 60e9;
        let jumped_ns = if tau < 1e9 * self.error.jump_at_s { 0.0 } else { 1e3 * self.error.jump_us };
        true_ns + (tau * (self.error.offset_ppm * 1e-6 + 0.5 * per_ns * tau) + jumped_ns).round() as i64
    }
}

/// Who drives a synchronisation wire: a crystal, and since when.
type Driver = Option<(Crystal, i64)>;

/// The wire from a master to its slaves. The master puts its clock on it when it starts.
#[derive(Clone, Debug, Default)]
pub struct SyncWire(Arc<Mutex<Driver>>);

impl SyncWire {
    /// A wire that nobody drives.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    fn drive(&self, driver: Driver) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = driver;
    }

    fn driver(&self) -> Driver {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a time base counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ClockMode {
    /// Its own crystal.
    #[default]
    Standalone,
    /// Its own crystal, which it puts on the wire.
    Master,
    /// The wire. Without a master, nothing: the time stays zero.
    Slave,
}

/// The microsecond counter of a sensor.
#[derive(Clone, Debug)]
pub struct TimeBase {
    crystal: Crystal,
    wire: SyncWire,
    mode: ClockMode,
    started_ns: Option<i64>,
}

impl TimeBase {
    /// A stopped counter.
    #[must_use]
    pub fn new(crystal: Crystal, wire: SyncWire) -> Self {
        Self { crystal, wire, mode: ClockMode::Standalone, started_ns: None }
    }

    /// Starts from zero.
    pub fn start(&mut self, mode: ClockMode, now_ns: i64) {
        self.stop();
        self.mode = mode;
        self.started_ns = Some(now_ns);
        if mode == ClockMode::Master {
            self.wire.drive(Some((self.crystal, now_ns)));
        }
    }

    /// Stops; a master leaves the wire.
    pub fn stop(&mut self) {
        if self.started_ns.take().is_some() && self.mode == ClockMode::Master {
            self.wire.drive(None);
        }
    }

    /// The true time from which it counts: its own start, or for a slave that of its master if that came later.
    #[must_use]
    pub fn zero_ns(&self) -> Option<i64> {
        let started = self.started_ns?;
        match self.mode {
            ClockMode::Slave => self.wire.driver().map(|(_, master_start)| started.max(master_start)),
            _ => Some(started),
        }
    }

    /// The count at a true time, microseconds: 0 before the start, and while a slave has no master.
    #[must_use]
    pub fn ticks_us(&self, at_ns: i64) -> u64 {
        let Some(started) = self.started_ns else { return 0 };
        let (crystal, from) = match self.mode {
            ClockMode::Slave => match self.wire.driver() {
                Some((crystal, master_start)) => (crystal, started.max(master_start)),
                None => return 0,
            },
            _ => (self.crystal, started),
        };
        let counted = crystal.elapsed_ns(at_ns) - crystal.elapsed_ns(from);
        u64::try_from(counted / 1000).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offset_and_a_drift_add_up() {
        let error = ClockError { offset_ppm: 100.0, drift_ppm_per_min: 1.0, ..ClockError::default() };
        let crystal = Crystal::new(error, 5);
        // One minute: 100 ppm are 6 ms; the drift adds half a ppm on average, 30 us.
        assert_eq!(crystal.elapsed_ns(60_000_000_005), 60_006_030_000);
    }

    #[test]
    fn a_count_that_jumps_goes_on_from_there() {
        let error = ClockError { jump_at_s: 2.0, jump_us: -500.0, ..ClockError::default() };
        let crystal = Crystal::new(error, 0);
        assert_eq!([1_999_999_999, 2_000_000_000].map(|t| crystal.elapsed_ns(t)), [1_999_999_999, 1_999_500_000]);
    }

    #[test]
    fn a_slave_counts_nothing_until_its_master_runs_and_then_the_masters_ticks() {
        let wire = SyncWire::new();
        let fast = ClockError { offset_ppm: 200.0, ..ClockError::default() };
        let mut master = TimeBase::new(Crystal::new(fast, 0), wire.clone());
        let mut slave = TimeBase::new(Crystal::new(ClockError::default(), 0), wire);
        slave.start(ClockMode::Slave, 1_000_000);
        assert_eq!(slave.ticks_us(900_000_000), 0);
        master.start(ClockMode::Master, 1_000_000_000);
        assert_eq!(slave.ticks_us(2_000_000_000), 1_000_200);
        assert_eq!(slave.ticks_us(2_000_000_000), master.ticks_us(2_000_000_000));
        master.stop();
        assert_eq!(slave.ticks_us(2_500_000_000), 0);
    }
}
