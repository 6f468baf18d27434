//! An outlet that keeps everything, for tests of drivers that run in real time.
#![allow(dead_code, reason = "each test uses a part of it")]

use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    thread::sleep,
    time::{Duration, Instant},
};

use erfgs_session::source::{Incident, Outlet, Packet};

/// How long a test waits for what must happen: long, since how soon it does is the machine's affair.
const PATIENCE: Duration = Duration::from_secs(60);
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// What came.
#[derive(Default)]
pub struct Kept {
    packets: Mutex<Vec<Packet>>,
    incidents: Mutex<Vec<Incident>>,
}

impl Outlet for Kept {
    fn send(&self, packet: Packet) -> bool {
        self.packets().push(packet);
        true
    }

    fn report(&self, incident: Incident) {
        self.incidents().push(incident);
    }
}

impl Kept {
    /// The packets so far.
    pub fn packets(&self) -> MutexGuard<'_, Vec<Packet>> {
        self.packets.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The incidents so far.
    pub fn incidents(&self) -> MutexGuard<'_, Vec<Incident>> {
        self.incidents.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until `done` says so; fails after a minute, and tells the incidents then.
    pub fn wait(&self, what: &str, mut done: impl FnMut(&Self) -> bool) {
        let describe =
            || format!("{what}; {} packets came, and of incidents {:?}", self.packets().len(), self.incidents());
        wait_for(describe, || done(self));
    }

    /// Waits for so many packets in all.
    pub fn wait_packets(&self, count: usize) {
        self.wait(&format!("{count} packets"), |kept| kept.packets().len() >= count);
    }

    /// Waits until a lost device is back.
    pub fn wait_back(&self) {
        self.wait("the return", |kept| kept.incidents().contains(&Incident::Back));
    }
}

/// Waits until `done` says so; fails after a minute with what `describe` says that should have happened.
pub fn wait_for(describe: impl Fn() -> String, mut done: impl FnMut() -> bool) {
    let began = Instant::now();
    while !done() {
        assert!(began.elapsed() < PATIENCE, "this does not happen: {}", describe());
        sleep(LOOK_EVERY);
    }
}
