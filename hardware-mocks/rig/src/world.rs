//! The clock that all devices and drivers live by.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicI64, Ordering},
    },
    time::Duration,
};

use crate::bus::{Clock, Offer, Step};

/// How far the clock moves at a time, nanoseconds.
const STEP_NS: i64 = 1_000_000;

/// A clock that moves when everybody has been asked, and when a driver waits.
pub struct World {
    now_ns: AtomicI64,
    streams: Mutex<Vec<Arc<Offer>>>,
}

/// What is asked at each step.
pub trait Stepped: Send {
    /// Does all that is due until `now_ns`.
    fn until(&mut self, now_ns: i64);
}

impl World {
    /// A world that begins at a time.
    #[must_use]
    pub fn new(now_ns: i64) -> Self {
        Self { now_ns: AtomicI64::new(now_ns), streams: Mutex::default() }
    }

    /// Lets time pass until `end_ns`; `progress` hears the share that has passed.
    pub fn run(&self, end_ns: i64, devices: &mut [Box<dyn Stepped>], progress: &mut dyn FnMut(f64)) {
        let begun_ns = self.now_ns();
        while self.now_ns() < end_ns {
            let now_ns = self.now_ns.fetch_add(STEP_NS, Ordering::SeqCst) + STEP_NS;
            devices.iter_mut().for_each(|device| device.until(now_ns));
            // A driver that brings its camera back may add a stream meanwhile.
            let streams = std::mem::take(&mut *self.streams());
            let goes_on = |stream: &Arc<Offer>| loop {
                match stream.step() {
                    Step::Moved => {}
                    Step::Idle => return true,
                    Step::Ended => return false,
                }
            };
            let left: Vec<_> = streams.into_iter().filter(goes_on).collect();
            self.streams().extend(left);
            progress((now_ns - begun_ns) as f64 / (end_ns - begun_ns) as f64);
        }
    }

    fn streams(&self) -> std::sync::MutexGuard<'_, Vec<Arc<Offer>>> {
        self.streams.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Clock for World {
    fn now_ns(&self) -> i64 {
        self.now_ns.load(Ordering::SeqCst)
    }

    fn pass(&self, duration: Duration) {
        self.now_ns.fetch_add(i64::try_from(duration.as_nanos()).unwrap_or(0), Ordering::SeqCst);
    }

    fn take_over(&self, offer: &Arc<Offer>) -> bool {
        self.streams().push(Arc::clone(offer));
        true
    }
}
