//! What the sources, the reading thread and those who steer share.

use std::{
    path::PathBuf,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

use erfgs_session::{
    container::Status,
    source::{Counters, Incident, Outlet, Packet},
};

use super::PlayerOptions;

/// How fast a session is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// So many times as fast as it was recorded; above 0.
    Times(f64),
    /// As fast as the receivers take it.
    Max,
}

impl Default for Speed {
    fn default() -> Self {
        Self::Times(1.0)
    }
}

/// Where a stream's packets go.
pub(super) enum Seat {
    /// The source was not started yet.
    Waiting,
    Started(Arc<dyn Outlet>),
    Stopped,
    /// The source was dropped.
    Gone,
}

/// What is to be done; changes wake the reading thread.
#[derive(Clone, Copy, Debug)]
pub(super) struct Orders {
    pub options: PlayerOptions,
    pub paused: bool,
    /// Counts the jumps that were asked for.
    pub jumps: u64,
}

pub(super) struct Shared {
    pub path: PathBuf,
    pub conductor: Mutex<Option<JoinHandle<()>>>,
    seats: Vec<Mutex<Seat>>,
    counters: Vec<Mutex<Counters>>,
    orders: Mutex<Orders>,
    changed: Condvar,
    status: Mutex<Status>,
    /// Recorded host time of the last packet that was sent.
    position_ns: AtomicI64,
    finished: AtomicBool,
    failure: Mutex<Option<String>>,
    /// Damaged places that the last round passed over.
    damaged: AtomicU64,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Nothing that is held across a panic is left half-changed.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    pub fn new(path: PathBuf, options: PlayerOptions, streams: usize) -> Self {
        Self {
            path,
            conductor: Mutex::new(None),
            seats: (0..streams).map(|_| Mutex::new(Seat::Waiting)).collect(),
            counters: (0..streams).map(|_| Mutex::default()).collect(),
            orders: Mutex::new(Orders { options, paused: false, jumps: 0 }),
            changed: Condvar::new(),
            status: Mutex::default(),
            position_ns: AtomicI64::new(i64::MIN),
            finished: AtomicBool::new(false),
            failure: Mutex::new(None),
            damaged: AtomicU64::new(0),
        }
    }

    /// Changes where a stream's packets go. No packet goes to the former outlet after this.
    pub fn set(&self, stream: usize, seat: Seat) {
        if matches!(seat, Seat::Started(_)) {
            *locked(&self.counters[stream]) = Counters::default();
        }
        *locked(&self.seats[stream]) = seat;
        let _orders = locked(&self.orders);
        self.changed.notify_all();
    }

    /// Whether all sources that there are were started.
    pub fn all_started(&self) -> bool {
        self.seats.iter().all(|seat| matches!(*locked(seat), Seat::Started(_) | Seat::Gone))
    }

    /// Whether nobody listens any more.
    pub fn all_stopped(&self) -> bool {
        self.seats.iter().all(|seat| !matches!(*locked(seat), Seat::Started(_)))
    }

    pub fn counters(&self, stream: usize) -> Counters {
        *locked(&self.counters[stream])
    }

    pub fn readings(&self, id: &str) -> Vec<(String, f64)> {
        let status = locked(&self.status);
        let readings = status.streams.get(id).into_iter().flat_map(|stream| &stream.readings);
        readings.filter_map(|(name, value)| Some((name.clone(), (*value)?))).collect()
    }

    pub fn note_status(&self, status: Status) {
        *locked(&self.status) = status;
    }

    pub fn orders(&self) -> Orders {
        *locked(&self.orders)
    }

    /// Waits for a change of orders, or so long.
    pub fn wait(&self, time: Duration) {
        let orders = locked(&self.orders);
        drop(self.changed.wait_timeout(orders, time));
    }

    /// Sends a packet. `false` if the outlet had no room.
    pub fn send(&self, stream: usize, packet: &Packet, recorded_ns: i64) -> bool {
        let seat = locked(&self.seats[stream]);
        let Seat::Started(outlet) = &*seat else { return true };
        let taken = outlet.send(packet.clone());
        let mut counters = locked(&self.counters[stream]);
        if taken {
            counters.packets += 1;
            counters.bytes += packet.payload.len() as u64;
        }
        self.position_ns.store(recorded_ns, Ordering::Relaxed);
        taken
    }

    /// Counts a packet that no outlet took.
    pub fn refused(&self, stream: usize) {
        locked(&self.counters[stream]).refused += 1;
    }

    pub fn report(&self, stream: usize, incident: Incident) {
        if let Seat::Started(outlet) = &*locked(&self.seats[stream]) {
            outlet.report(incident);
        }
    }

    pub fn set_finished(&self, finished: bool) {
        self.finished.store(finished, Ordering::Release);
    }

    /// A round begins.
    pub fn forget_damage(&self) {
        self.damaged.store(0, Ordering::Relaxed);
    }

    /// A damaged place is passed over.
    pub fn pass_over(&self, damage: String) {
        self.damaged.fetch_add(1, Ordering::Relaxed);
        self.fail(damage);
    }

    pub fn fail(&self, failure: String) {
        *locked(&self.failure) = Some(failure);
    }
}

/// Steers a playback.
#[derive(Clone)]
pub struct Controls {
    shared: Arc<Shared>,
    start_ns: i64,
}

impl Controls {
    pub(super) fn new(shared: Arc<Shared>, start_ns: i64) -> Self {
        Self { shared, start_ns }
    }

    fn order(&self, change: impl FnOnce(&mut Orders)) {
        change(&mut locked(&self.shared.orders));
        self.shared.changed.notify_all();
    }

    /// Halts, or goes on.
    pub fn pause(&self, paused: bool) {
        self.order(|orders| orders.paused = paused);
    }

    /// Jumps to a session time, nanoseconds.
    pub fn seek(&self, session_ns: i64) {
        self.order(|orders| {
            orders.options.seek_ns = session_ns;
            orders.jumps += 1;
        });
    }

    /// The session time that is being played, nanoseconds; `None` before the first packet.
    #[must_use]
    pub fn position_ns(&self) -> Option<i64> {
        let recorded = self.shared.position_ns.load(Ordering::Relaxed);
        (recorded != i64::MIN).then(|| recorded.saturating_sub(self.start_ns))
    }

    /// Whether the end was reached. A jump makes the playback go on.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.shared.finished.load(Ordering::Acquire)
    }

    /// Damaged places that the last round passed over, whose packets were not played.
    #[must_use]
    pub fn damaged(&self) -> u64 {
        self.shared.damaged.load(Ordering::Relaxed)
    }

    /// Why the playback ended before its end; also the last damaged place that it passed over.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        locked(&self.shared.failure).clone()
    }
}
