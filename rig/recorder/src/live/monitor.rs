//! The monitor: looks at packets as they pass the recorder, within a bounded share of one core.

use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, MutexGuard, OnceLock, PoisonError,
        atomic::{AtomicBool, AtomicI64, Ordering::Relaxed},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use erfgs_session::source::{Description, Encoding, Packet};

pub use super::eye::Look;
use super::{
    eye::{Eye, Inbox},
    guide::{Guidance, Guide},
};
use crate::{StreamStatus, Subscriber};
use erfgs_rig::host_time::host_ns;

/// Pictures are made while somebody asked for one within this long, nanoseconds.
const WATCHED_NS: i64 = 3_000_000_000;
/// Shortest and longest rest between two rounds.
const REST: [Duration; 2] = [Duration::from_millis(15), Duration::from_secs(1)];

/// How much the monitor may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonitorOptions {
    /// Share of one core, 0.01 to 1.
    pub share: f64,
    /// Pictures of each camera a second, at most.
    pub pictures_hz: f64,
}

impl Default for MonitorOptions {
    fn default() -> Self {
        Self { share: 0.25, pictures_hz: 8.0 }
    }
}

struct WatchedStream {
    encoding: Encoding,
    id: String,
    inbox: Mutex<Inbox>,
    eye: Mutex<Eye>,
    wanted_ns: AtomicI64,
}

struct Shared {
    streams: Vec<WatchedStream>,
    quit: AtomicBool,
}

/// See the module.
pub struct Monitor {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
    guide: OnceLock<Arc<dyn Guide>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Monitor {
    /// Starts to look at streams of these descriptions, in this order.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new<'a>(
        descriptions: impl IntoIterator<Item = &'a Description>,
        options: MonitorOptions,
    ) -> std::io::Result<Arc<Self>> {
        let stream = |description: &Description| WatchedStream {
            encoding: description.encoding,
            id: description.id.clone(),
            inbox: Mutex::default(),
            eye: Mutex::new(Eye::new(description)),
            wanted_ns: AtomicI64::new(i64::MIN),
        };
        let streams = descriptions.into_iter().map(stream).collect();
        let shared = Arc::new(Shared { streams, quit: AtomicBool::new(false) });
        let thread = thread::Builder::new().name("monitor".into()).spawn({
            let shared = Arc::clone(&shared);
            move || look(&shared, options)
        })?;
        Ok(Arc::new(Self { shared, thread: Mutex::new(Some(thread)), guide: OnceLock::new() }))
    }

    /// Lets `guide` see the packets, too, and add to the page. The first one stays.
    pub fn guide(&self, guide: Arc<dyn Guide>) {
        let _ = self.guide.set(guide);
    }

    /// What the guide has to say.
    #[must_use]
    pub fn guidance(&self) -> Vec<Guidance> {
        self.guide.get().map(|guide| guide.guidance()).unwrap_or_default()
    }

    /// What the page is told of the pictures.
    #[must_use]
    pub fn looks(&self) -> Vec<Look> {
        self.shared.streams.iter().map(|stream| lock(&stream.eye).look()).collect()
    }

    /// The last picture of stream `id`, JPEG; asking makes the monitor draw further ones for some seconds.
    #[must_use]
    pub fn preview(&self, id: &str) -> Option<Vec<u8>> {
        let stream = self.shared.streams.iter().find(|stream| stream.id == id)?;
        stream.wanted_ns.store(host_ns(), Relaxed);
        lock(&stream.eye).jpeg()
    }
}

impl Subscriber for Monitor {
    fn packet(&self, stream: usize, packet: &Packet) {
        if let Some(guide) = self.guide.get() {
            guide.packet(stream, packet);
        }
        if let Some(stream) = self.shared.streams.get(stream) {
            lock(&stream.inbox).put(stream.encoding, packet);
        }
    }

    fn annotate(&self, stream: usize, status: &mut StreamStatus) {
        let Some(stream) = self.shared.streams.get(stream) else { return };
        let eye = lock(&stream.eye);
        if let Some([events_per_byte, share]) = eye.events_per_byte() {
            status.events_per_s = Some(events_per_byte * status.bytes_per_s);
            status.decoded_share = Some(share);
        }
        status.clock = eye.clock();
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.shared.quit.store(true, Relaxed);
        if let Some(thread) = lock(&self.thread).take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

/// Goes round the streams; after each round rests long enough to keep to the share.
fn look(shared: &Shared, options: MonitorOptions) {
    let share = options.share.clamp(0.01, 1.0);
    let between = Duration::from_secs_f64(1.0 / options.pictures_hz.clamp(0.1, 60.0));
    let mut drawn: Vec<Option<Instant>> = vec![None; shared.streams.len()];
    while !shared.quit.load(Relaxed) {
        let begun = Instant::now();
        for (stream, drawn) in shared.streams.iter().zip(&mut drawn) {
            let (packets, offered): (VecDeque<Packet>, u64) = lock(&stream.inbox).take();
            let mut eye = lock(&stream.eye);
            eye.see(packets, offered);
            let first = drawn.is_none() && offered > 0;
            let watched = host_ns().saturating_sub(stream.wanted_ns.load(Relaxed)) < WATCHED_NS;
            let due = drawn.is_none_or(|at| at.elapsed() >= between);
            if (first || watched) && due && stream.encoding != Encoding::TriggerLines {
                eye.draw();
                *drawn = Some(Instant::now());
            }
        }
        let rest = begun.elapsed().mul_f64(1.0 / share - 1.0);
        thread::park_timeout(rest.clamp(REST[0], REST[1]));
    }
}
