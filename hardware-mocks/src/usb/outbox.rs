//! What a sensor has ready for the host, and what it counts.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
};

use serde::Serialize;

/// What a sensor counted since it was powered up for the first time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SensorCounts {
    /// Events that the scene caused while the sensor was streaming.
    pub seen: u64,
    /// Those that masks or the event-rate controller took away.
    pub filtered: u64,
    /// Those that were lost because the host did not read.
    pub lost: u64,
    /// Those that were encoded for the host.
    pub sent: u64,
    /// Edges at the trigger input that were encoded for the host.
    pub edges: u64,
    /// Frames that were encoded for the host (DAVIS346).
    pub frames: u64,
    /// Inertial samples that were encoded for the host (DAVIS346).
    pub imu: u64,
}

/// A handle to the counts of a device that a front end owns.
#[derive(Clone, Debug, Default)]
pub struct SharedCounts(Arc<Mutex<SensorCounts>>);

impl SharedCounts {
    /// The counts at this moment.
    #[must_use]
    pub fn get(&self) -> SensorCounts {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn update(&self, change: impl FnOnce(&mut SensorCounts)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

/// Bytes that wait for the host in batches, each ready from some time on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Queue {
    bytes: VecDeque<u8>,
    batches: VecDeque<(i64, usize)>,
    open: usize,
}

impl Queue {
    pub(crate) fn len(&self) -> usize {
        self.bytes.len()
    }

    pub(crate) fn clear(&mut self) {
        *self = Self::default();
    }

    pub(crate) fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend(bytes);
        self.open += bytes.len();
    }

    /// Bytes in the batch that is still open.
    pub(crate) fn open(&self) -> usize {
        self.open
    }

    /// What was pushed since the last batch becomes ready at `ready_ns`, and not before the batches in front of it.
    pub(crate) fn close(&mut self, ready_ns: i64) {
        if self.open > 0 {
            let ready = self.batches.back().map_or(ready_ns, |&(last, _)| last.max(ready_ns));
            self.batches.push_back((ready, std::mem::take(&mut self.open)));
        }
    }

    /// When the next batch is ready.
    pub(crate) fn ready_ns(&self) -> Option<i64> {
        self.batches.front().map(|&(ready, _)| ready)
    }

    /// Up to `length` bytes of the batches that are ready. A host that keeps up receives a transfer for each batch; for
    /// one that lags they fill its transfers.
    pub(crate) fn take(&mut self, length: usize, now_ns: i64) -> Option<Vec<u8>> {
        let mut count = 0;
        while let Some((_, left)) = self.batches.front_mut().filter(|(ready, _)| *ready <= now_ns && count < length) {
            let part = (length - count).min(*left);
            *left -= part;
            count += part;
            if *left == 0 {
                self.batches.pop_front();
            }
        }
        (count > 0).then(|| self.bytes.drain(..count).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transfer_holds_what_is_ready() {
        let mut queue = Queue::default();
        queue.push(&[1, 2, 3]);
        queue.close(10);
        queue.push(&[4, 5]);
        queue.close(5);
        assert_eq!(queue.take(2, 9), None);
        assert_eq!(queue.take(2, 10), Some(vec![1, 2]));
        // A batch never overtakes the one before it.
        queue.push(&[6]);
        queue.close(20);
        assert_eq!(queue.take(9, 10), Some(vec![3, 4, 5]));
        assert_eq!(queue.take(9, 19), None);
        assert_eq!(queue.take(9, 20), Some(vec![6]));
        assert_eq!(queue.take(9, 100), None);
    }
}
