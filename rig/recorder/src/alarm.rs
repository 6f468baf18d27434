//! What makes a recorder keep the past by itself: a rise of the event rate, or an edge at the trigger input of an event
//! camera. Both are looked for in a thread of their own, in packets as they pass.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use erfgs_events::{CdEvent, Decoder, Edge, EventBatch, Sink, StreamDecoder};
use erfgs_session::{
    container::{hand_over, sensor_size},
    source::{Description, Packet},
};

use super::{Subscriber, status::StreamStatus};

/// Packets that may wait to be looked at.
const WAITING: usize = 4096;
/// A rate is that of so much time, nanoseconds of arrival.
const WINDOW_NS: i64 = 50_000_000;
/// The rate that a rise is compared with follows within about so many windows: two seconds.
const MEMORY: f64 = 40.0;
/// Windows before a rise can be told.
const ENOUGH: u32 = 20;
/// Bytes of a window that are no rise, whatever came before: some thousand events a second.
const LEAST_BYTES: f64 = 1000.0;

/// What to look for.
#[derive(Clone, Debug, PartialEq)]
pub enum AlarmKind {
    /// The data of an event camera come more than so many times as fast as in the two seconds before.
    Rate(f64),
    /// The trigger input of an event camera rises; of this one, or of any.
    Edge(Option<String>),
}

/// Called with the stream and what was detected in it.
pub type OnAlarm = Box<dyn Fn(&str, &str) + Send>;

/// See the module.
pub struct Alarm {
    sender: Mutex<Option<SyncSender<(usize, Packet)>>>,
    skipped: AtomicBool,
    next: Option<Arc<dyn Subscriber>>,
    thread: Option<JoinHandle<()>>,
    quit: Arc<AtomicBool>,
}

impl Alarm {
    /// Starts to look at event streams of these descriptions, in this order; packets are passed on to `next`.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new<'a>(
        descriptions: impl IntoIterator<Item = &'a Description>,
        kinds: Vec<AlarmKind>,
        next: Option<Arc<dyn Subscriber>>,
        on_alarm: OnAlarm,
    ) -> std::io::Result<Self> {
        let watched: Vec<Watched> =
            descriptions.into_iter().map(|description| Watched::new(description, &kinds)).collect();
        let (sender, receiver) = sync_channel(WAITING);
        let quit = Arc::new(AtomicBool::new(false));
        let thread = thread::Builder::new().name("alarm".into()).spawn({
            let quit = Arc::clone(&quit);
            move || watch(watched, &receiver, &quit, &on_alarm)
        })?;
        let sender = Mutex::new(Some(sender));
        Ok(Self { sender, skipped: AtomicBool::new(false), next, thread: Some(thread), quit })
    }
}

impl Subscriber for Alarm {
    fn packet(&self, stream: usize, packet: &Packet) {
        if let Some(next) = &self.next {
            next.packet(stream, packet);
        }
        let sender = self.sender.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(sender) = sender.as_ref() {
            let mut packet = packet.clone();
            // What is not looked at leaves a gap.
            packet.discontinuity |= self.skipped.load(Relaxed);
            let sent = sender.try_send((stream, packet));
            self.skipped.store(matches!(sent, Err(TrySendError::Full(_))), Relaxed);
        }
    }

    fn annotate(&self, stream: usize, status: &mut StreamStatus) {
        if let Some(next) = &self.next {
            next.annotate(stream, status);
        }
    }
}

impl Drop for Alarm {
    fn drop(&mut self) {
        self.quit.store(true, Relaxed);
        *self.sender.lock().unwrap_or_else(PoisonError::into_inner) = None;
        if let Some(thread) = self.thread.take()
            // The last one to let go may be the thread itself, when it tells.
            && thread.thread().id() != thread::current().id()
        {
            let _ = thread.join();
        }
    }
}

fn watch(mut streams: Vec<Watched>, packets: &Receiver<(usize, Packet)>, quit: &AtomicBool, on_alarm: &OnAlarm) {
    while !quit.load(Relaxed) {
        match packets.recv_timeout(Duration::from_millis(100)) {
            Ok((stream, packet)) => {
                if let Some(stream) = streams.get_mut(stream) {
                    for what in stream.see(&packet) {
                        on_alarm(&stream.id, &what);
                    }
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// A stream that is looked at.
struct Watched {
    id: String,
    rate: Option<Rate>,
    edges: Option<StreamDecoder>,
    begun: bool,
}

impl Watched {
    fn new(description: &Description, kinds: &[AlarmKind]) -> Self {
        let encoding = description.encoding.events();
        let factor =
            kinds.iter().find_map(|kind| if let AlarmKind::Rate(factor) = kind { Some(*factor) } else { None });
        let edges = kinds.iter().any(|kind| match kind {
            AlarmKind::Edge(id) => id.as_ref().is_none_or(|id| *id == description.id),
            AlarmKind::Rate(_) => false,
        });
        Self {
            id: description.id.clone(),
            rate: encoding.and(factor).map(Rate::new),
            edges: encoding.filter(|_| edges).map(|encoding| StreamDecoder::new(encoding, sensor_size(description))),
            begun: false,
        }
    }

    fn see(&mut self, packet: &Packet) -> Vec<String> {
        let mut seen = Vec::new();
        if let Some(times) = self.rate.as_mut().and_then(|rate| rate.take(packet.host_ns, packet.payload.len())) {
            seen.push(format!("its events came {times:.1} times as fast"));
        }
        if let Some(decoder) = &mut self.edges {
            hand_over(decoder, packet, self.begun);
            self.begun = true;
            let mut rises = Rises(0);
            decoder.decode(&packet.payload, &mut rises);
            if rises.0 > 0 {
                seen.push("its trigger input rose".to_owned());
            }
        }
        seen
    }
}

/// Counts rising edges.
struct Rises(u64);

impl Sink for Rises {
    fn event(&mut self, _event: CdEvent) {}

    fn events(&mut self, _batch: EventBatch<'_>) {}

    fn edge(&mut self, edge: Edge) {
        self.0 += u64::from(edge.rising);
    }
}

/// Compares the rate of a window with the mean of those before.
struct Rate {
    factor: f64,
    window: Option<i64>,
    bytes: f64,
    mean: f64,
    windows: u32,
    /// Within the window that runs it was told already.
    is_reported: bool,
}

impl Rate {
    fn new(factor: f64) -> Self {
        Self { factor, window: None, bytes: 0.0, mean: 0.0, windows: 0, is_reported: false }
    }

    /// Takes a packet; gives how many times as fast data come, if that is a rise.
    fn take(&mut self, host_ns: i64, bytes: usize) -> Option<f64> {
        let window = host_ns.div_euclid(WINDOW_NS);
        let last = *self.window.get_or_insert(window);
        // Windows that are over, with those in which nothing came; a longer silence forgets everything.
        for _ in 0..window.saturating_sub(last).clamp(0, 4 * MEMORY as i64) {
            self.windows = self.windows.saturating_add(1);
            let weight = (1.0 / f64::from(self.windows)).max(1.0 / MEMORY);
            self.mean += weight * (self.bytes - self.mean);
            (self.bytes, self.is_reported) = (0.0, false);
        }
        self.window = Some(window);
        self.bytes += bytes as f64;
        let usual = self.mean.max(LEAST_BYTES);
        let rises = self.windows >= ENOUGH && !self.is_reported && self.bytes > self.factor * usual;
        self.is_reported |= rises;
        rises.then(|| self.bytes / usual)
    }
}

#[cfg(test)]
mod tests {
    use erfgs_events::{EventEncoding, Evt3Encoder};
    use erfgs_session::source::Encoding;

    use super::*;

    #[test]
    fn a_rise_is_told_once_within_a_window_and_a_steady_rate_never() {
        let mut rate = Rate::new(3.0);
        let mut rises = Vec::new();
        for ms in 0..6000_i64 {
            let bytes = if (4000..4100).contains(&ms) { 5000 } else { 900 + (ms % 7) as usize * 50 };
            rises.extend(rate.take(ms * 1_000_000, bytes).map(|times| (ms, times)));
        }
        assert!((1..=2).contains(&rises.len()), "{rises:?}");
        let (ms, times) = rises[0];
        assert!((4000..4050).contains(&ms) && times > 3.0, "{rises:?}");
    }

    #[test]
    fn what_just_began_and_what_is_next_to_nothing_is_no_rise() {
        let mut rate = Rate::new(3.0);
        assert!((0..900).all(|ms| rate.take(ms * 1_000_000, 40 * ms as usize).is_none()), "nothing to compare with");
        let mut rate = Rate::new(3.0);
        assert!((0..9000).all(|ms| rate.take(ms * 1_000_000, usize::from(ms % 1000 > 900)).is_none()));
    }

    #[test]
    fn edges_of_the_camera_in_question_are_told() {
        let description = |id: &str| Description {
            id: id.into(),
            model: String::new(),
            serial: String::new(),
            encoding: Encoding::Events(EventEncoding::Evt3),
            width: 1280,
            height: 720,
            start_order: 0,
            settings: serde_json::Map::new(),
        };
        let streams = [description("left"), description("right")];
        let seen = Arc::new(Mutex::new(Vec::new()));
        let on_alarm: OnAlarm = Box::new({
            let seen = Arc::clone(&seen);
            move |stream, what| seen.lock().unwrap().push((stream.to_owned(), what.to_owned()))
        });
        let alarm = Alarm::new(&streams, vec![AlarmKind::Edge(Some("right".into()))], None, on_alarm).unwrap();
        let words = |rising| {
            let mut words = Vec::new();
            let mut encoder = Evt3Encoder::default();
            encoder.event(CdEvent { t_us: 10, x: 1, y: 2, on: true }, &mut words).unwrap();
            encoder.edge(Edge { t_us: 20, channel: 0, rising }, &mut words).unwrap();
            encoder.finish(&mut words);
            words
        };
        for (stream, rising) in [(0, true), (1, false), (1, true)] {
            let payload = words(rising).into();
            let packet = Packet { sequence: 0, host_ns: 0, discontinuity: false, damaged: false, stamp: None, payload };
            alarm.packet(stream, &packet);
        }
        let begun = std::time::Instant::now();
        while seen.lock().unwrap().is_empty() && begun.elapsed() < Duration::from_secs(60) {
            thread::sleep(Duration::from_millis(1));
        }
        drop(alarm);
        assert_eq!(*seen.lock().unwrap(), [("right".to_owned(), "its trigger input rose".to_owned())]);
    }
}
