//! The monitor: looks at packets as they pass the recorder, within a bounded share of one core.

use std::{
    collections::VecDeque,
    ops::RangeInclusive,
    sync::{
        Arc, Mutex, MutexGuard, OnceLock, PoisonError,
        atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering::Relaxed},
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

/// Pictures of events show so much of the past, microseconds: at first, and what can be asked for.
const SPAN_US: u64 = 50_000;
const SPANS_US: RangeInclusive<u64> = 100..=10_000_000;

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
    /// When it was last asked for, among others and enlarged.
    wanted_ns: [AtomicI64; 2],
}

struct Shared {
    streams: Vec<WatchedStream>,
    quit: AtomicBool,
    /// Pictures of events show the last so many microseconds.
    span_us: AtomicU64,
    /// Whether time stands still where no data come.
    stands: AtomicBool,
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
            wanted_ns: [const { AtomicI64::new(i64::MIN) }; 2],
        };
        let streams = descriptions.into_iter().map(stream).collect();
        let shared = Arc::new(Shared {
            streams,
            quit: AtomicBool::new(false),
            span_us: AtomicU64::new(SPAN_US),
            stands: AtomicBool::new(false),
        });
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

    /// The last picture of stream `id`, JPEG, enlarged if asked for; asking makes the monitor draw further ones for some
    /// seconds.
    #[must_use]
    pub fn preview(&self, id: &str, large: bool) -> Option<Vec<u8>> {
        let stream = self.shared.streams.iter().find(|stream| stream.id == id)?;
        stream.wanted_ns[usize::from(large)].store(host_ns(), Relaxed);
        lock(&stream.eye).jpeg(large)
    }

    /// How much of the past the pictures of events show, microseconds.
    #[must_use]
    pub fn span_us(&self) -> u64 {
        self.shared.span_us.load(Relaxed)
    }

    /// Lets the pictures of events show the last `span_us`, from a tenth of a millisecond to ten seconds; what lies outside
    /// becomes the nearest of these.
    pub fn show_span_us(&self, span_us: u64) {
        self.shared.span_us.store(span_us.clamp(*SPANS_US.start(), *SPANS_US.end()), Relaxed);
    }

    /// Says that a recording is played: where no data come, time stands still, and the pictures stay.
    pub fn of_playback(&self) {
        self.shared.stands.store(true, Relaxed);
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
            let now_ns = host_ns();
            let watched = |by: &AtomicI64| now_ns.saturating_sub(by.load(Relaxed)) < WATCHED_NS;
            let [small, large] = &stream.wanted_ns;
            let due = drawn.is_none_or(|at| at.elapsed() >= between);
            let wanted = first || watched(small) || watched(large);
            if wanted && due && stream.encoding != Encoding::TriggerLines {
                eye.draw(shared.span_us.load(Relaxed), !shared.stands.load(Relaxed), watched(large));
                *drawn = Some(Instant::now());
            }
        }
        let rest = begun.elapsed().mul_f64(1.0 / share - 1.0);
        thread::park_timeout(rest.clamp(REST[0], REST[1]));
    }
}
