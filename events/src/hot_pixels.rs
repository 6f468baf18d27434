//! Hot pixels: those that send events all the time, whatever they look at.
//!
//! What moves makes many events where it passes and when it passes. A hot pixel makes them evenly in time, and its neighbours do not.

use super::sink::{CdEvent, EventBatch, Sink};

/// Parts that the recording is divided into.
const PARTS: u64 = u64::BITS as u64;
/// The first length of a part, microseconds; it doubles as often as the recording asks for.
const FIRST_PART_US: u64 = 1 << 10;
/// A hot pixel has so many events at least, and so many times as many as its neighbour with the second most: two hot ones may lie side by
/// side, and the end of a thin line that blinks has two neighbours.
const FEWEST: u32 = 30;
const MORE: u32 = 8;
const RANK: usize = 1;
/// How far neighbours reach, pixels.
const REACH: usize = 2;
/// It has events in so large a share of the parts in which a pixel that sends them evenly by chance would have some.
const EVEN: f64 = 0.7;
/// In fewer parts nothing can be told.
const FEWEST_PARTS: u32 = 16;

/// A pixel that sends events all the time.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct HotPixel {
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
    /// Its events.
    pub events: u32,
    /// Its events a second.
    pub rate_hz: f64,
}

/// How often, and in which parts of a recording, each pixel of a sensor had events.
#[derive(Clone, Debug)]
pub struct PixelActivity {
    size: [usize; 2],
    counts: Vec<u32>,
    /// A bit for each part.
    parts: Vec<u64>,
    part_us: u64,
    first_us: Option<u64>,
    last_us: u64,
}

impl PixelActivity {
    /// Of a sensor of so many columns and rows.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        let pixels = width * height;
        Self {
            size: [width, height],
            counts: vec![0; pixels],
            parts: vec![0; pixels],
            part_us: FIRST_PART_US,
            first_us: None,
            last_us: 0,
        }
    }

    /// Takes an event. One outside of the sensor is not counted.
    pub fn take(&mut self, t_us: u64, x: u16, y: u16) {
        let [width, height] = self.size;
        let (x, y) = (usize::from(x), usize::from(y));
        if x >= width || y >= height {
            return;
        }
        let first_us = *self.first_us.get_or_insert(t_us);
        self.last_us = self.last_us.max(t_us);
        let since_us = t_us.saturating_sub(first_us);
        while since_us / self.part_us >= PARTS {
            self.part_us = self.part_us.saturating_mul(2);
            self.parts.iter_mut().for_each(|parts| *parts = halved(*parts));
        }
        let pixel = y * width + x;
        self.counts[pixel] = self.counts[pixel].saturating_add(1);
        self.parts[pixel] |= 1 << (since_us / self.part_us);
    }

    /// The pixels that send events all the time, those with the most first. None of a recording that is shorter than 16 ms, which tells
    /// nothing.
    #[must_use]
    pub fn hot_pixels(&self) -> Vec<HotPixel> {
        let Some(first_us) = self.first_us else { return Vec::new() };
        let span_us = self.last_us - first_us;
        let all = (span_us / self.part_us) as u32 + 1;
        if all < FEWEST_PARTS {
            return Vec::new();
        }
        let is_even = |pixel: usize| {
            let expected = 1.0 - (-f64::from(self.counts[pixel]) / f64::from(all)).exp();
            f64::from(self.parts[pixel].count_ones()) >= EVEN * expected * f64::from(all)
        };
        let is_hot = |pixel: usize| {
            let count = self.counts[pixel];
            count >= FEWEST && is_even(pixel) && count / MORE >= self.neighbours(pixel)
        };
        let [width, _] = self.size;
        let hot = (0..self.counts.len()).filter(|&pixel| is_hot(pixel)).map(|pixel| HotPixel {
            x: (pixel % width) as u16,
            y: (pixel / width) as u16,
            events: self.counts[pixel],
            rate_hz: f64::from(self.counts[pixel]) / (span_us as f64 * 1e-6),
        });
        let mut hot: Vec<HotPixel> = hot.collect();
        hot.sort_by_key(|pixel| std::cmp::Reverse(pixel.events));
        hot
    }

    /// The second most events among its neighbours.
    fn neighbours(&self, pixel: usize) -> u32 {
        let [width, height] = self.size;
        let [x, y] = [pixel % width, pixel / width];
        let [columns, rows] =
            [(x, width), (y, height)].map(|(at, end)| at.saturating_sub(REACH)..(at + REACH + 1).min(end));
        let mut most = [0; RANK + 1];
        for other in rows.flat_map(|row| columns.clone().map(move |column| row * width + column)) {
            if other != pixel && self.counts[other] > most[RANK] {
                most[RANK] = self.counts[other];
                most.sort_unstable_by(|a, b| b.cmp(a));
            }
        }
        most[RANK]
    }
}

/// Parts of twice the length: each has what either of two had.
fn halved(parts: u64) -> u64 {
    let both = parts | parts >> 1;
    // Every second bit, moved together.
    [
        (0x5555_5555_5555_5555, 0),
        (0x3333_3333_3333_3333, 1),
        (0x0f0f_0f0f_0f0f_0f0f, 2),
        (0x00ff_00ff_00ff_00ff, 4),
        (0x0000_ffff_0000_ffff, 8),
        (0x0000_0000_ffff_ffff, 16),
    ]
    .into_iter()
    .fold(both, |word, (mask, shift)| (word | word >> shift) & mask)
}

impl Sink for PixelActivity {
    fn event(&mut self, event: CdEvent) {
        self.take(event.t_us, event.x, event.y);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        for ((&t_us, &x), &y) in batch.t_us.iter().zip(batch.x).zip(batch.y) {
            self.take(t_us, x, y);
        }
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    fn uniform(n: u64, purpose: u64) -> f64 {
        random::range(random::key(3, &[n, purpose]), 0.0, 1.0)
    }

    /// A second of a sensor of 100 x 80: noise, a bar that crosses it and turns back, a line that blinks, and three hot pixels.
    fn activity(hot: &[(u16, u16, f64)]) -> PixelActivity {
        let mut events: Vec<(u64, u16, u16)> = Vec::new();
        for n in 0..4000 {
            events.push(((1e6 * uniform(n, 0)) as u64, (100.0 * uniform(n, 1)) as u16, (80.0 * uniform(n, 2)) as u16));
        }
        for t_us in (0..1_000_000).step_by(500) {
            let x = (50.0 + 45.0 * (t_us as f64 * 1e-6 * 6.0).sin()) as u16;
            (20..40).for_each(|y| events.push((t_us, x, y)));
        }
        for t_us in (0..1_000_000).step_by(10_000) {
            (10..60).for_each(|y| events.push((t_us, 97, y)));
        }
        for (of, &(x, y, hz)) in hot.iter().enumerate() {
            let times = (0..hz as u64).map(|n| (1e6 * uniform(n, 10 + of as u64)) as u64);
            events.extend(times.map(|t_us| (t_us, x, y)));
        }
        events.sort_unstable();
        let mut activity = PixelActivity::new(100, 80);
        events.iter().for_each(|&(t_us, x, y)| activity.take(5_000_000 + t_us, x, y));
        activity
    }

    #[test]
    fn hot_pixels_are_found_beside_noise_and_what_moves_and_nothing_else_is() {
        let hot = [(3, 70, 40.0), (4, 70, 500.0), (0, 0, 5000.0), (99, 79, 100.0), (60, 5, 200.0)];
        let found = activity(&hot).hot_pixels();
        let mut places: Vec<(u16, u16)> = found.iter().map(|pixel| (pixel.x, pixel.y)).collect();
        assert_eq!(places[..2], [(0, 0), (4, 70)], "the hottest first");
        places.sort_unstable();
        let mut expected: Vec<(u16, u16)> = hot.iter().map(|&(x, y, _)| (x, y)).collect();
        expected.sort_unstable();
        assert_eq!(places, expected);
        assert!((found[0].rate_hz - 5000.0).abs() < 10.0, "{:?}", found[0]);
        assert_eq!(activity(&[]).hot_pixels(), []);
    }

    #[test]
    fn what_is_short_or_lies_outside_tells_nothing() {
        assert_eq!(PixelActivity::new(10, 10).hot_pixels(), []);
        let mut activity = PixelActivity::new(10, 10);
        (0..1000).for_each(|n| activity.take(n, 5, 5));
        assert_eq!(activity.hot_pixels(), [], "a millisecond");
        (0..1000).for_each(|n| activity.take(1000 * n, 10, 5));
        activity.take(u64::MAX, 5, 5);
        activity.take(0, 5, 5);
        assert!(activity.hot_pixels().is_empty());
        // A pixel that flashes once, however often.
        let mut activity = PixelActivity::new(10, 10);
        (0..5000).for_each(|n| activity.take(400_000 + 10 * n, 5, 5));
        (0..1000).for_each(|n| activity.take(1000 * n, (n % 10) as u16, 0));
        assert_eq!(activity.hot_pixels(), []);
    }

    #[test]
    fn two_parts_become_one() {
        assert_eq!(
            [halved(0), halved(0b11), halved(0b1000_0110), halved(u64::MAX)],
            [0, 1, 0b1011, u64::from(u32::MAX)]
        );
        assert_eq!(halved(1 << 63), 1 << 31);
    }
}
