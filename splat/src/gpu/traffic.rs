//! What passes between the host and the device, counted.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// How much passed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Submissions, of one recording or of those that were held back.
    pub submissions: u64,
    /// Dispatches recorded for them.
    pub dispatches: u64,
    /// Buffers mapped for reading, each of which is waited for.
    pub maps: u64,
    /// Bytes written to buffers.
    pub written: u64,
    /// Bytes read from buffers.
    pub read: u64,
}

impl Traffic {
    /// What passed since then.
    #[must_use]
    pub fn since(self, before: Self) -> Self {
        Self {
            submissions: self.submissions - before.submissions,
            dispatches: self.dispatches - before.dispatches,
            maps: self.maps - before.maps,
            written: self.written - before.written,
            read: self.read - before.read,
        }
    }

    /// The larger of both, each count by itself.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        Self {
            submissions: self.submissions.max(other.submissions),
            dispatches: self.dispatches.max(other.dispatches),
            maps: self.maps.max(other.maps),
            written: self.written.max(other.written),
            read: self.read.max(other.read),
        }
    }
}

impl std::ops::AddAssign for Traffic {
    fn add_assign(&mut self, more: Self) {
        self.submissions += more.submissions;
        self.dispatches += more.dispatches;
        self.maps += more.maps;
        self.written += more.written;
        self.read += more.read;
    }
}

/// Counts since a device was opened.
#[derive(Debug, Default)]
pub(super) struct Counters {
    submissions: AtomicU64,
    dispatches: AtomicU64,
    maps: AtomicU64,
    written: AtomicU64,
    read: AtomicU64,
}

impl Counters {
    pub(super) fn submitted(&self) {
        self.submissions.fetch_add(1, Relaxed);
    }

    pub(super) fn dispatched(&self, dispatches: u64) {
        self.dispatches.fetch_add(dispatches, Relaxed);
    }

    pub(super) fn mapped(&self, bytes: u64) {
        self.maps.fetch_add(1, Relaxed);
        self.read.fetch_add(bytes, Relaxed);
    }

    pub(super) fn written(&self, bytes: u64) {
        self.written.fetch_add(bytes, Relaxed);
    }

    pub(super) fn so_far(&self) -> Traffic {
        Traffic {
            submissions: self.submissions.load(Relaxed),
            dispatches: self.dispatches.load(Relaxed),
            maps: self.maps.load(Relaxed),
            written: self.written.load(Relaxed),
            read: self.read.load(Relaxed),
        }
    }
}
