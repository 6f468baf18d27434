//! The share of one stream in the queue: what of it waits in memory, what was dropped and where, what was written.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};

use serde::{Deserialize, Serialize};

/// Memory that a waiting packet takes beside its payload; keeps floods of empty packets bounded.
pub(super) const PACKET_OVERHEAD: usize = 256;

/// Counts packets and their bytes.
#[derive(Debug, Default)]
pub(super) struct Count {
    packets: AtomicU64,
    bytes: AtomicU64,
}

impl Count {
    pub fn add(&self, payload: usize) {
        self.packets.fetch_add(1, Relaxed);
        self.bytes.fetch_add(payload as u64, Relaxed);
    }

    pub fn packets(&self) -> u64 {
        self.packets.load(Relaxed)
    }

    pub fn bytes(&self) -> u64 {
        self.bytes.load(Relaxed)
    }
}

/// The share of one stream in the [queue](super::queue), as counts: the packets themselves wait in the queue, in the order
/// of their arrival. Used by the threads of the stream's source, the writer and the watchdog.
#[derive(Debug, Default)]
pub(super) struct StreamQueue {
    /// Bytes that may wait in memory.
    pub limit: usize,
    waiting: AtomicUsize,
    peak: AtomicUsize,
    /// Dropped for want of room.
    pub refused: Count,
    /// Not taken by the session file.
    pub unwritten: Count,
    /// In the session file.
    pub written: Count,
    /// The next packet follows a gap of our making.
    gap: AtomicBool,
}

impl StreamQueue {
    pub fn new(limit: usize) -> Self {
        Self { limit, ..Self::default() }
    }

    /// Reserves room for a packet, or counts it as dropped.
    pub fn reserve(&self, payload: usize) -> bool {
        let cost = payload + PACKET_OVERHEAD;
        let waiting = self.waiting.fetch_add(cost, Relaxed) + cost;
        if waiting > self.limit {
            self.waiting.fetch_sub(cost, Relaxed);
            self.refused.add(payload);
            self.mark_gap();
            return false;
        }
        self.peak.fetch_max(waiting, Relaxed);
        true
    }

    /// Gives the room of a packet back.
    pub fn release(&self, payload: usize) {
        self.waiting.fetch_sub(payload + PACKET_OVERHEAD, Relaxed);
    }

    /// Marks the next packet as following a gap.
    pub fn mark_gap(&self) {
        self.gap.store(true, Relaxed);
    }

    /// Whether a gap lies before the packet at hand; asking clears it.
    pub fn take_gap(&self) -> bool {
        self.gap.load(Relaxed) && self.gap.swap(false, Relaxed)
    }

    /// Bytes that wait now, and the most that ever did.
    pub fn waiting(&self) -> (usize, usize) {
        (self.waiting.load(Relaxed), self.peak.load(Relaxed))
    }

    /// The losses, with those that the driver tells of.
    pub fn drops(&self, driver: u64) -> Drops {
        Drops {
            driver,
            queue: self.refused.packets(),
            queue_bytes: self.refused.bytes(),
            writer: self.unwritten.packets(),
            writer_bytes: self.unwritten.bytes(),
        }
    }
}

/// What a stream lost, by the stage that lost it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Drops {
    /// Packets or frames lost in the device, the kernel or the driver, as far as these tell.
    pub driver: u64,
    /// Packets dropped because the queue of the stream was full: the disk is too slow.
    pub queue: u64,
    /// Their bytes.
    pub queue_bytes: u64,
    /// Packets that were taken and that the session file then refused: the disk is full or fails.
    pub writer: u64,
    /// Their bytes.
    pub writer_bytes: u64,
}

impl Drops {
    /// Packets lost at any stage.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.driver + self.queue + self.writer
    }
}
