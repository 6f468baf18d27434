//! Events on their way to a sink, gathered in columns that fit the first-level cache.

use super::sink::{EventBatch, Sink};

/// Capacity: a power of two.
const CAPACITY: usize = 1024;

/// Which bits of a byte are set, lowest first; the rest is 0.
const BITS: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut bit, mut count) = (0, 0);
        while bit < 8 {
            if mask >> bit & 1 == 1 {
                table[mask][count] = bit as u8;
                count += 1;
            }
            bit += 1;
        }
        mask += 1;
    }
    table
};

/// The columns from `first` on whose bits are set in a byte; the rest is `first`.
#[inline(always)]
pub(super) fn columns(first: u16, byte: u8) -> [u16; 8] {
    BITS[usize::from(byte)].map(|bit| first + u16::from(bit))
}

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

    /// Appends the events of a row: bit i of `mask` stands for column `first + i`.
    #[inline(always)]
    pub fn push_columns(&mut self, t_us: u64, first: u16, y: u16, on: bool, mask: u32, sink: &mut impl Sink) {
        // All columns, and what the last eight write beyond their events.
        const ROOM: usize = 32 + 8;
        self.room(ROOM, sink);
        let Some((times, xs, ys, ons)) = self.take::<ROOM>() else { return };
        // Events before each byte, which the next need not wait for.
        let before = [0, mask & 0xFF, mask & 0xFFFF, mask & 0xFF_FFFF].map(|bits| bits.count_ones() as usize);
        for ((from, byte), before) in (first..).step_by(8).zip(mask.to_le_bytes()).zip(before) {
            if let Some(xs) = xs[before..].first_chunk_mut() {
                *xs = columns(from, byte);
            }
        }
        let count = mask.count_ones() as usize;
        let halves =
            times.as_chunks_mut::<16>().0.iter_mut().zip(ys.as_chunks_mut::<16>().0).zip(ons.as_chunks_mut::<16>().0);
        // There are seldom events for both.
        for ((times, ys), ons) in halves.take(if count > 16 { 2 } else { 1 }) {
            (*times, *ys, *ons) = ([t_us; 16], [y; 16], [on; 16]);
        }
        self.give_back(ROOM - count);
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
