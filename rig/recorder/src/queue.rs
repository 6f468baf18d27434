//! The queue between the sources and the writer: one for a recording, bounded in bytes for each stream.

use std::{
    collections::VecDeque,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use erfgs_session::source::{Incident, Packet};

use super::{status::Status, stream_queue::StreamQueue};

/// Incidents and status lines that may wait; a device that reports without end fills no memory.
const NOTES: usize = 4096;

/// What the writer is handed.
pub(super) enum Item {
    Packet { stream: usize, packet: Packet },
    Incident { stream: Option<usize>, host_ns: i64, incident: Incident },
    Status(Arc<Status>),
}

#[derive(Default)]
struct Inner {
    items: VecDeque<Item>,
    notes: usize,
    closed: bool,
}

/// See the module.
pub(super) struct Queue {
    inner: Mutex<Inner>,
    ready: Condvar,
    /// The streams, in the order of the session.
    pub streams: Vec<StreamQueue>,
}

impl Queue {
    pub fn new(streams: Vec<StreamQueue>) -> Self {
        Self { inner: Mutex::default(), ready: Condvar::new(), streams }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a packet, or drops it and counts it where its stream has no room. Never waits for the disk.
    pub fn packet(&self, stream: usize, mut packet: Packet) -> bool {
        let Some(share) = self.streams.get(stream) else { return false };
        if !share.reserve(packet.payload.len()) {
            return false;
        }
        packet.discontinuity |= share.take_gap();
        let mut inner = self.lock();
        if inner.closed {
            drop(inner);
            share.release(packet.payload.len());
            return false;
        }
        inner.items.push_back(Item::Packet { stream, packet });
        drop(inner);
        self.ready.notify_one();
        true
    }

    /// Takes an incident or a status; drops it when thousands wait.
    pub fn note(&self, item: Item) {
        let mut inner = self.lock();
        if inner.closed || inner.notes >= NOTES {
            return;
        }
        inner.notes += 1;
        inner.items.push_back(item);
        drop(inner);
        self.ready.notify_one();
    }

    /// Moves everything that waits into `batch`; waits until `until` for the first item. `false`: the queue is closed
    /// and `batch` holds its end.
    pub fn take(&self, batch: &mut VecDeque<Item>, until: Instant) -> bool {
        let mut inner = self.lock();
        while inner.items.is_empty() && !inner.closed {
            let left = until.saturating_duration_since(Instant::now());
            if left == Duration::ZERO {
                break;
            }
            inner = self.ready.wait_timeout(inner, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        std::mem::swap(&mut inner.items, batch);
        inner.notes = 0;
        !inner.closed
    }

    /// Lets nothing more in.
    pub fn close(&self) {
        self.lock().closed = true;
        self.ready.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;

    use super::{super::stream_queue::PACKET_OVERHEAD, *};

    fn packet(sequence: u64, bytes: usize) -> Packet {
        Packet {
            sequence,
            host_ns: 0,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: Bytes::from(vec![0; bytes]),
        }
    }

    fn queue(limits: &[usize]) -> Queue {
        Queue::new(limits.iter().map(|&limit| StreamQueue::new(limit)).collect())
    }

    fn taken(queue: &Queue) -> Vec<(usize, Packet)> {
        let mut batch = VecDeque::new();
        queue.take(&mut batch, Instant::now());
        let packets = batch.into_iter().filter_map(|item| match item {
            Item::Packet { stream, packet } => Some((stream, packet)),
            _ => None,
        });
        packets.collect()
    }

    #[test]
    fn a_full_stream_drops_and_counts_while_others_go_on() {
        let queue = queue(&[2 * (100 + PACKET_OVERHEAD), 1 << 20]);
        assert!(queue.packet(0, packet(0, 100)) && queue.packet(0, packet(1, 100)));
        assert!(!queue.packet(0, packet(2, 100)), "the third packet exceeds the limit");
        assert!(queue.packet(1, packet(0, 5000)));
        let drops = queue.streams[0].drops(0);
        assert_eq!((drops.queue, drops.queue_bytes, drops.writer), (1, 100, 0));
        assert_eq!(queue.streams[1].drops(0), Default::default());
        assert_eq!(queue.streams[0].waiting().1, 2 * (100 + PACKET_OVERHEAD));
    }

    #[test]
    fn the_first_packet_after_a_drop_says_that_data_are_missing() {
        let queue = queue(&[2 * (100 + PACKET_OVERHEAD)]);
        assert!(queue.packet(0, packet(0, 200)) && !queue.packet(0, packet(1, 1)));
        for (_, packet) in taken(&queue) {
            queue.streams[0].release(packet.payload.len());
        }
        assert!(queue.packet(0, packet(2, 10)) && queue.packet(0, packet(3, 10)));
        let marks: Vec<(u64, bool)> =
            taken(&queue).into_iter().map(|(_, packet)| (packet.sequence, packet.discontinuity)).collect();
        assert_eq!(marks, [(2, true), (3, false)]);
    }

    #[test]
    fn room_is_given_back_only_when_the_writer_is_done() {
        let queue = queue(&[100 + PACKET_OVERHEAD]);
        assert!(queue.packet(0, packet(0, 100)));
        let held = taken(&queue);
        assert!(!queue.packet(0, packet(1, 100)), "the writer still holds the first packet");
        queue.streams[0].release(held[0].1.payload.len());
        assert!(queue.packet(0, packet(2, 100)));
    }

    #[test]
    fn a_closed_queue_gives_what_it_holds_and_takes_nothing() {
        let queue = queue(&[1000]);
        assert!(queue.packet(0, packet(0, 1)));
        queue.close();
        assert!(!queue.packet(0, packet(1, 1)));
        let mut batch = VecDeque::new();
        assert!(!queue.take(&mut batch, Instant::now() + Duration::from_secs(60)));
        assert_eq!(batch.len(), 1);
        assert_eq!(queue.streams[0].waiting().0, 1 + PACKET_OVERHEAD);
    }

    #[test]
    fn reports_without_end_fill_no_memory() {
        let queue = queue(&[1000]);
        for _ in 0..3 * NOTES {
            let incident = Incident::Warning { message: "again".into() };
            queue.note(Item::Incident { stream: Some(0), host_ns: 0, incident });
        }
        let mut batch = VecDeque::new();
        queue.take(&mut batch, Instant::now());
        assert_eq!(batch.len(), NOTES);
    }
}
