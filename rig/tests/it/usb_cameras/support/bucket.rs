//! An outlet that keeps everything.

use std::{
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::Duration,
};

use erfgs_session::source::{Incident, Outlet, Packet};

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// See the module.
#[derive(Default)]
pub struct Bucket {
    pub packets: Mutex<Vec<Packet>>,
    pub incidents: Mutex<Vec<Incident>>,
    /// Refuse this many packets first.
    pub refuse: AtomicUsize,
}

impl Outlet for Bucket {
    fn send(&self, packet: Packet) -> bool {
        let refuse = self.refuse.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1));
        if refuse.is_ok() {
            return false;
        }
        lock(&self.packets).push(packet);
        true
    }

    fn report(&self, incident: Incident) {
        lock(&self.incidents).push(incident);
    }
}

impl Bucket {
    /// All bytes, in order.
    pub fn bytes(&self) -> Vec<u8> {
        lock(&self.packets).iter().flat_map(|packet| packet.payload.iter().copied()).collect()
    }

    /// What was reported so far.
    pub fn incidents(&self) -> Vec<Incident> {
        lock(&self.incidents).clone()
    }

    /// Waits until `done` says so; fails after five minutes of wall time, which a busy machine may need.
    pub fn wait_until(&self, what: &str, mut done: impl FnMut(&Self) -> bool) {
        for _ in 0..300_000 {
            if done(self) {
                return;
            }
            thread::sleep(Duration::from_millis(1));
        }
        panic!("never happened: {what}; told: {:?}", self.incidents());
    }

    fn len(&self) -> usize {
        lock(&self.packets).iter().map(|packet| packet.payload.len()).sum()
    }

    /// Waits for so many bytes more.
    pub fn wait_for_bytes(&self, count: usize) {
        let before = self.len();
        self.wait_until("more data", |bucket| bucket.len() >= before + count);
    }
}
