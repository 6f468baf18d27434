//! Where the packets of all streams go: nowhere, into memory that forgets what is old, or into a recording. The change from
//! one to the other happens for all streams at once, and no packet is lost or overtaken by it.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError, RwLock},
    time::Duration,
};

use erfgs_session::source::{Incident, Packet};

use super::{
    queue::{Item, Queue},
    stream_queue::PACKET_OVERHEAD,
};

/// How much of the past is held, so that a recording can begin before it was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Before {
    /// So long.
    pub span: Duration,
    /// In so much memory, at most, bytes; what is older goes first.
    pub bytes: u64,
}

/// See the module.
pub(super) struct Gate {
    before: Option<Before>,
    streams: usize,
    state: RwLock<State>,
}

enum State {
    Off,
    Holding(Mutex<Past>),
    Recording(Arc<Queue>),
}

/// What came last.
#[derive(Default)]
struct Past {
    items: VecDeque<Item>,
    bytes: u64,
}

/// What is held at a moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Held {
    pub first_host_ns: Option<i64>,
    pub last_host_ns: Option<i64>,
    pub bytes: u64,
}

impl Gate {
    pub fn new(streams: usize, before: Option<Before>) -> Self {
        Self { before, streams, state: RwLock::new(Self::at_rest(before)) }
    }

    fn at_rest(before: Option<Before>) -> State {
        before.map_or(State::Off, |_| State::Holding(Mutex::default()))
    }

    fn with<T>(&self, act: impl FnOnce(&State) -> T) -> T {
        act(&self.state.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Takes a packet; `false` if a recording had no room for it.
    pub fn packet(&self, stream: usize, packet: Packet) -> bool {
        self.with(|state| match state {
            State::Off => true,
            State::Holding(past) => {
                self.hold(past, Item::Packet { stream, packet });
                true
            }
            State::Recording(queue) => queue.packet(stream, packet),
        })
    }

    /// Takes note of what happened to a stream.
    pub fn incident(&self, stream: usize, host_ns: i64, incident: Incident) {
        let item = Item::Incident { stream: Some(stream), host_ns, incident };
        self.with(|state| match state {
            State::Off => {}
            State::Holding(past) => self.hold(past, item),
            State::Recording(queue) => queue.note(item),
        });
    }

    fn hold(&self, past: &Mutex<Past>, item: Item) {
        let Some(before) = self.before else { return };
        let span_ns = i64::try_from(before.span.as_nanos()).unwrap_or(i64::MAX);
        let oldest_ns = host_ns(&item).saturating_sub(span_ns);
        let mut past = past.lock().unwrap_or_else(PoisonError::into_inner);
        past.bytes += cost(&item);
        past.items.push_back(item);
        while let Some(first) = past.items.front()
            && (past.bytes > before.bytes || host_ns(first) < oldest_ns)
        {
            past.bytes -= cost(first);
            past.items.pop_front();
        }
    }

    /// What is held; `None` where nothing is: a recording runs, or the past is not wanted.
    pub fn held(&self) -> Option<Held> {
        self.with(|state| {
            let State::Holding(past) = state else { return None };
            let past = past.lock().unwrap_or_else(PoisonError::into_inner);
            Some(Held {
                // Streams overtake each other by little.
                first_host_ns: past.items.iter().take(64).map(host_ns).min(),
                last_host_ns: past.items.back().map(host_ns),
                bytes: past.bytes,
            })
        })
    }

    /// From now on everything goes into the queue that `queue` makes, told how many bytes of each stream it starts with: what
    /// was held goes in first.
    pub fn record(&self, queue: impl FnOnce(&[usize]) -> Queue) -> Arc<Queue> {
        let mut state = self.state.write().unwrap_or_else(PoisonError::into_inner);
        let past = match &mut *state {
            State::Holding(past) => std::mem::take(past.get_mut().unwrap_or_else(PoisonError::into_inner)),
            State::Off | State::Recording(_) => Past::default(),
        };
        let mut bytes = vec![0; self.streams];
        for item in &past.items {
            if let Item::Packet { stream, packet } = item
                && let Some(bytes) = bytes.get_mut(*stream)
            {
                *bytes += packet.payload.len() + PACKET_OVERHEAD;
            }
        }
        let queue = Arc::new(queue(&bytes));
        for item in past.items {
            match item {
                Item::Packet { stream, packet } => drop(queue.packet(stream, packet)),
                note => queue.note(note),
            }
        }
        *state = State::Recording(Arc::clone(&queue));
        queue
    }

    /// The recording ends. When this returns no packet is on its way into it.
    pub fn rest(&self) {
        *self.state.write().unwrap_or_else(PoisonError::into_inner) = Self::at_rest(self.before);
    }
}

fn cost(item: &Item) -> u64 {
    let payload = if let Item::Packet { packet, .. } = item { packet.payload.len() } else { 0 };
    (payload + PACKET_OVERHEAD) as u64
}

fn host_ns(item: &Item) -> i64 {
    match item {
        Item::Packet { packet, .. } => packet.host_ns,
        Item::Incident { host_ns, .. } => *host_ns,
        Item::Status(status) => status.host_ns,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::{super::stream_queue::StreamQueue, *};

    fn packet(sequence: u64, ms: i64, bytes: usize) -> Packet {
        Packet {
            sequence,
            host_ns: ms * 1_000_000,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: vec![0; bytes].into(),
        }
    }

    fn queue(limit: usize) -> impl FnOnce(&[usize]) -> Queue {
        move |held| Queue::new(held.iter().map(|held| StreamQueue::new(limit + held)).collect())
    }

    fn sequences(queue: &Queue) -> Vec<(usize, u64)> {
        let mut batch = VecDeque::new();
        queue.take(&mut batch, Instant::now());
        let sequence =
            |item| if let Item::Packet { stream, packet } = item { Some((stream, packet.sequence)) } else { None };
        batch.into_iter().filter_map(sequence).collect()
    }

    #[test]
    fn a_recording_begins_with_what_was_held_and_goes_on_without_a_gap() {
        let gate = Gate::new(2, Some(Before { span: Duration::from_millis(100), bytes: 1 << 20 }));
        for n in 0..50 {
            assert!(gate.packet(n as usize % 2, packet(n, 10 * n as i64, 100)));
        }
        let held = gate.held().unwrap();
        assert_eq!((held.first_host_ns, held.last_host_ns), (Some(390_000_000), Some(490_000_000)));
        let queue = gate.record(queue(100 + PACKET_OVERHEAD));
        assert!(gate.held().is_none());
        assert!(gate.packet(0, packet(50, 500, 100)), "the held packets take nothing of the queue's room");
        assert!(!gate.packet(0, packet(52, 520, 100)), "which is full by now");
        let found = sequences(&queue);
        assert_eq!(found.first(), Some(&(1, 39)));
        assert!(found.windows(2).all(|pair| pair[1].1 == pair[0].1 + 1), "{found:?}");
        assert_eq!(found.last(), Some(&(0, 50)));
        gate.rest();
        assert_eq!(gate.held(), Some(Held::default()));
        assert!(gate.packet(0, packet(60, 600, 1)) && sequences(&queue).is_empty());
    }

    #[test]
    fn the_past_takes_no_more_memory_than_it_may() {
        let gate = Gate::new(1, Some(Before { span: Duration::from_secs(1000), bytes: 10_000 }));
        for n in 0..1000 {
            gate.packet(0, packet(n, n as i64, 744));
        }
        let held = gate.held().unwrap();
        assert_eq!((held.bytes, held.first_host_ns), (10_000, Some(990_000_000)));
    }

    #[test]
    fn without_a_past_nothing_is_held() {
        let gate = Gate::new(1, None);
        assert!(gate.packet(0, packet(0, 0, 10)) && gate.held().is_none());
        let queue = gate.record(queue(1 << 20));
        assert!(gate.packet(0, packet(1, 1, 10)));
        assert_eq!(sequences(&queue), [(0, 1)]);
    }
}
