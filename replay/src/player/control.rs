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
    /// Where the last jump leads, nanoseconds of session time.
    pub target_ns: i64,
    /// What may pass while the playback is paused.
    pub step: Step,
}

/// What a paused playback lets through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Step {
    #[default]
    Nothing,
    /// What was recorded up to this session time, nanoseconds.
    UpTo(i64),
    /// Everything up to the next packet of a stream.
    Packet(usize),
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
            orders: Mutex::new(Orders {
                options,
                paused: false,
                jumps: 0,
                target_ns: options.seek_ns,
                step: Step::Nothing,
            }),
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

    /// A paused playback stands at this recorded time, which no packet has.
    pub fn stand_at(&self, recorded_ns: i64) {
        self.position_ns.store(recorded_ns, Ordering::Relaxed);
    }

    /// The end of this step is reached, if it is the one that was asked for.
    pub fn stepped(&self, step: Step) {
        let mut orders = locked(&self.orders);
        if orders.step == step {
            orders.step = Step::Nothing;
        }
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
        self.order(|orders| (orders.paused, orders.step) = (paused, Step::Nothing));
    }

    /// Whether the playback is halted.
    #[must_use]
    pub fn paused(&self) -> bool {
        self.shared.orders().paused
    }

    /// Jumps to a session time, nanoseconds. A paused playback stays paused there, and shows what was recorded just before.
    pub fn seek(&self, session_ns: i64) {
        self.order(|orders| {
            orders.target_ns = session_ns.max(0);
            orders.step = if orders.paused { Step::UpTo(orders.target_ns) } else { Step::Nothing };
            orders.jumps += 1;
        });
    }

    /// Halts, and plays what was recorded in the next so many nanoseconds; where they are negative, jumps back by them.
    pub fn step(&self, span_ns: i64) {
        let to_ns = self.position_ns().unwrap_or(0).saturating_add(span_ns).max(0);
        if span_ns < 0 {
            self.pause(true);
            return self.seek(to_ns);
        }
        self.order(|orders| (orders.paused, orders.step) = (true, Step::UpTo(to_ns)));
    }

    /// Halts, and plays up to the next packet of a stream, counted in the order of the recording: the next frame of a camera.
    pub fn step_packet(&self, stream: usize) {
        self.order(|orders| (orders.paused, orders.step) = (true, Step::Packet(stream)));
    }

    /// How fast it plays.
    #[must_use]
    pub fn speed(&self) -> Speed {
        self.shared.orders().options.speed
    }

    /// Changes how fast it plays.
    pub fn set_speed(&self, speed: Speed) {
        self.order(|orders| orders.options.speed = speed);
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
