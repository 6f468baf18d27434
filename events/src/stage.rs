//! Events on their way to a sink, gathered in columns that fit the first-level cache.

use super::sink::{EventBatch, Sink};

/// Capacity: a power of two.
const CAPACITY: usize = 1024;

/// A batch that is being filled.
#[derive(Clone, Debug)]
pub(super) struct Stage {
    t_us: Box<[u64; CAPACITY]>,
    x: Box<[u16; CAPACITY]>,
    y: Box<[u16; CAPACITY]>,
    on: Box<[bool; CAPACITY]>,
    length: usize,
}

impl Default for Stage {
    fn default() -> Self {
        Self {
            t_us: Box::new([0; CAPACITY]),
            x: Box::new([0; CAPACITY]),
            y: Box::new([0; CAPACITY]),
            on: Box::new([false; CAPACITY]),
            length: 0,
        }
    }
}

impl Stage {
    /// Appends an event. There must be room: see [`Stage::room`].
    #[inline(always)]
    pub fn push(&mut self, t_us: u64, x: u16, y: u16, on: bool) {
        let at = self.length & (CAPACITY - 1);
        self.t_us[at] = t_us;
        self.x[at] = x;
        self.y[at] = y;
        self.on[at] = on;
        self.length += 1;
    }

    /// Makes room for `count` events (at most [`CAPACITY`]).
    #[inline(always)]
    pub fn room(&mut self, count: usize, sink: &mut impl Sink) {
        debug_assert!(count <= CAPACITY);
        if self.length + count > CAPACITY {
            self.flush(sink);
        }
    }

    /// Columns of `COUNT` further events to be filled, for which there must be room.
    #[inline(always)]
    #[allow(clippy::type_complexity)]
    pub fn take<const COUNT: usize>(
        &mut self,
    ) -> Option<(&mut [u64; COUNT], &mut [u16; COUNT], &mut [u16; COUNT], &mut [bool; COUNT])> {
        let from = self.length;
        let columns = (
            self.t_us.get_mut(from..)?.first_chunk_mut()?,
            self.x.get_mut(from..)?.first_chunk_mut()?,
            self.y.get_mut(from..)?.first_chunk_mut()?,
            self.on.get_mut(from..)?.first_chunk_mut()?,
        );
        self.length += COUNT;
        Some(columns)
    }

    /// Takes the last `count` events back.
    #[inline(always)]
    pub fn give_back(&mut self, count: usize) {
        self.length -= count;
    }

    /// Hands all events over.
    pub fn flush(&mut self, sink: &mut impl Sink) {
        let length = std::mem::take(&mut self.length).min(CAPACITY);
        if length > 0 {
            sink.events(EventBatch {
                t_us: &self.t_us[..length],
                x: &self.x[..length],
                y: &self.y[..length],
                on: &self.on[..length],
            });
        }
    }
}
