//! A clock that does not wait for the wall's.

use std::{
    sync::{
        Arc,
        atomic::{AtomicI64, Ordering},
    },
    thread,
    time::Duration,
};

use super::bus::{Clock, EmulatedBus};

/// Moves when a driver waits, when a read finds nothing yet and while a stream runs (a millisecond for each time that
/// nothing is there). Nanoseconds.
struct Simulated(AtomicI64);

impl Clock for Simulated {
    fn now_ns(&self) -> i64 {
        self.0.load(Ordering::SeqCst)
    }

    fn pass(&self, duration: Duration) {
        self.0.fetch_add(i64::try_from(duration.as_nanos()).unwrap(), Ordering::SeqCst);
        thread::yield_now();
    }
}

/// A simulated clock.
pub fn simulated() -> Arc<dyn Clock> {
    Arc::new(Simulated(AtomicI64::new(1_000_000_000)))
}

/// On a simulated clock.
impl Default for EmulatedBus {
    fn default() -> Self {
        Self::new(simulated())
    }
}
