//! Patterns of which everything is known: which event comes when, and which picture a frame shows.

use std::{collections::BTreeMap, sync::Arc};

use erfgs_events::CdEvent;

use super::{EventScene, FrameScene, Picture};
use crate::usb::clock::TimeBase;

/// A pixel fires after the other, row by row, at a constant rate on the sensor's own clock.
///
/// Event `k` happens `k / rate` after the counter's zero, at pixel `k` (row by row, modulo the number of pixels); it is
/// ON if bit 5 of `k` is set. So the place of an event tells its number modulo the number of pixels, its time tells the
/// number itself, and a receiver can check that nothing is missing, twice or displaced.
#[derive(Clone, Debug)]
pub struct Pattern {
    width: u16,
    height: u16,
    rate_hz: u64,
    next: u64,
}

impl Pattern {
    /// A pattern for a sensor of `width` x `height` pixels, with `rate_hz` events a second.
    #[must_use]
    pub fn new(width: u16, height: u16, rate_hz: u64) -> Self {
        Self { width: width.max(1), height: height.max(1), rate_hz, next: 0 }
    }

    /// Event number `k`.
    #[must_use]
    pub fn event(&self, k: u64) -> CdEvent {
        let (width, height) = (u64::from(self.width), u64::from(self.height));
        CdEvent { t_us: self.time_us(k), x: (k % width) as u16, y: (k / width % height) as u16, on: k & 32 != 0 }
    }

    /// The first event that happens at or after a time.
    #[must_use]
    pub fn first_at(&self, t_us: u64) -> u64 {
        let product = u128::from(t_us) * u128::from(self.rate_hz);
        u64::try_from(product.div_ceil(1_000_000)).unwrap_or(u64::MAX)
    }

    fn time_us(&self, k: u64) -> u64 {
        // The whole microsecond at which the event has happened: `first_at` is its inverse.
        (u128::from(k) * 1_000_000 / u128::from(self.rate_hz.max(1))) as u64
    }
}

impl EventScene for Pattern {
    fn begin(&mut self, clock: &TimeBase, now_ns: i64) {
        self.next = self.first_at(clock.ticks_us(now_ns));
    }

    fn until(&mut self, clock: &TimeBase, now_ns: i64, events: &mut Vec<CdEvent>) {
        if self.rate_hz == 0 {
            return;
        }
        let now_us = clock.ticks_us(now_ns);
        while self.time_us(self.next) <= now_us {
            events.push(self.event(self.next));
            self.next += 1;
        }
    }
}

/// A colour chart that moves by one step each frame and starts again after 16.
#[derive(Clone, Debug, Default)]
pub struct PatternFrames {
    made: BTreeMap<(u64, u32, u32), Arc<Picture>>,
}

impl PatternFrames {
    /// How many different pictures there are.
    pub const PICTURES: u64 = 16;

    /// A chart.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Picture `key` (0 to 15).
    #[must_use]
    pub fn picture(key: u64, width: u32, height: u32) -> Picture {
        let mut rgb = Vec::with_capacity((width * height * 3) as usize);
        let shift = (key as u32) * width / Self::PICTURES as u32;
        for y in 0..height {
            for x in 0..width {
                let u = (x + shift) % width.max(1);
                let tile = (u / 16 + y / 16) % 2 * 48;
                rgb.extend([(u * 200 / width) as u8 + tile as u8, (y * 200 / height) as u8 + tile as u8, 64]);
            }
        }
        Picture { width, height, rgb }
    }
}

impl FrameScene for PatternFrames {
    fn frame(&mut self, number: u64, _exposure_ns: [i64; 2], width: u32, height: u32) -> (u64, Arc<Picture>) {
        let key = number % Self::PICTURES;
        let picture =
            self.made.entry((key, width, height)).or_insert_with(|| Arc::new(Self::picture(key, width, height)));
        (key, Arc::clone(picture))
    }

    fn known(&mut self, width: u32, height: u32) -> Vec<(u64, Arc<Picture>)> {
        (0..Self::PICTURES).map(|key| self.frame(key, [0, 0], width, height)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::usb::clock::{ClockError, ClockMode, Crystal, SyncWire};

    #[test]
    fn the_first_event_at_a_time_is_the_inverse_of_an_events_time() {
        for rate in [1, 7, 1000, 999_983, 1_000_000, 3_000_001, 50_000_000] {
            let pattern = Pattern::new(1280, 720, rate);
            for t in [0, 1, 2, 1000, 123_456, 10_000_000] {
                let k = pattern.first_at(t);
                assert!(pattern.event(k).t_us >= t, "rate {rate}, {t} us");
                assert!(k == 0 || pattern.event(k - 1).t_us < t, "rate {rate}, {t} us");
            }
        }
    }

    #[test]
    fn pieces_of_time_give_every_event_once() {
        let mut clock =
            TimeBase::new(Crystal::new(ClockError { offset_ppm: 37.0, ..ClockError::default() }, 0), SyncWire::new());
        clock.start(ClockMode::Standalone, 100);
        let mut pattern = Pattern::new(1280, 720, 333_333);
        pattern.begin(&clock, 2_000_000);
        let first = pattern.next;
        let mut events = Vec::new();
        for step in 1..500 {
            pattern.until(&clock, 2_000_000 + step * 77_777, &mut events);
        }
        assert!(events.len() > 12_000);
        for (offset, event) in events.iter().enumerate() {
            assert_eq!(*event, pattern.event(first + offset as u64));
        }
    }
}
