//! Pictures of what an event sensor saw within a span of time.

use erfgs_events::{ApsFrame, CdEvent, EventBatch, SensorSize, Sink, palette};

/// How strongly the oldest events of the span show; the newest show fully.
const OLDEST: f32 = 0.4;
/// Brightness of a frame under the events.
const UNDER: f32 = 0.7;
/// Columns and rows that are kept, at most; sensors have 2^11.
const LARGEST: u16 = 2048;

/// The last event of every pixel of a sensor, of which pictures of any span before now are made: where an event lies within
/// the span, the pixel is warm (brighter) or blue (darker), the newer the stronger, over the sensor's own frame where it has
/// one. Takes the events as a [`Sink`].
#[derive(Clone, Debug)]
pub struct EventPicture {
    width: u16,
    height: u16,
    /// Of each pixel: twice the time of its last event, microseconds, and whether that was a rise; 0 before the first.
    last: Vec<u64>,
    newest_us: Option<u64>,
    events: u64,
    /// Grey picture of the same sensor to draw over.
    under: Option<Vec<u8>>,
}

impl EventPicture {
    /// For a sensor of this size.
    #[must_use]
    pub fn new(size: SensorSize) -> Self {
        let (width, height) = (size.width.min(LARGEST), size.height.min(LARGEST));
        let last = vec![0; usize::from(width) * usize::from(height)];
        Self { width, height, last, newest_us: None, events: 0, under: None }
    }

    /// Columns and rows of the pictures at full size.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        [self.width.into(), self.height.into()]
    }

    /// Time of the newest event, microseconds of the device.
    #[must_use]
    pub fn newest_us(&self) -> Option<u64> {
        self.newest_us
    }

    /// Events that were taken so far.
    #[must_use]
    pub fn events(&self) -> u64 {
        self.events
    }

    /// Forgets all events: time may start anew.
    pub fn clear(&mut self) {
        self.last.fill(0);
        self.newest_us = None;
    }

    #[inline]
    fn put(&mut self, x: u16, y: u16, t_us: u64, on: bool) {
        if x < self.width && y < self.height {
            self.last[usize::from(y) * usize::from(self.width) + usize::from(x)] = (t_us << 1) | u64::from(on);
        }
    }

    /// The picture of the events of the last `span_us` before `now_us`, as rows of red, green and blue: each of its pixels
    /// shows the newest event of `step` times `step` pixels of the sensor.
    #[must_use]
    pub fn render(&self, now_us: u64, span_us: u64, step: u16) -> Vec<u8> {
        let step = usize::from(step.max(1));
        let (width, height) = (usize::from(self.width), usize::from(self.height));
        let span_us = span_us.max(1);
        let columns = width / step;
        let mut rgb = vec![0; 3 * columns * (height / step)];
        for (row, line) in rgb.chunks_exact_mut((3 * columns).max(1)).enumerate() {
            for (column, pixel) in line.chunks_exact_mut(3).enumerate() {
                let at = row * step * width + column * step;
                // Twice the time, and one more for a rise: the largest is the newest.
                let mut newest = 0;
                for y in 0..step {
                    for &last in &self.last[at + y * width..][..step] {
                        newest = last.max(newest);
                    }
                }
                let base = match &self.under {
                    Some(under) => [(f32::from(under[at]) * UNDER) as u8; 3],
                    None => palette::STILL,
                };
                let age_us = now_us.saturating_sub(newest >> 1);
                // Most pixels of most pictures have seen nothing lately.
                let colour = if newest == 0 || age_us > span_us {
                    base
                } else {
                    palette::blend(base, newest & 1 == 1, 1.0 - (1.0 - OLDEST) * age_us as f32 / span_us as f32)
                };
                pixel.copy_from_slice(&colour);
            }
        }
        rgb
    }
}

impl Sink for EventPicture {
    fn event(&mut self, event: CdEvent) {
        self.events += 1;
        self.newest_us = Some(event.t_us);
        self.put(event.x, event.y, event.t_us, event.on);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.events += batch.t_us.len() as u64;
        self.newest_us = batch.t_us.last().copied().or(self.newest_us);
        for (((&t_us, &x), &y), &on) in batch.t_us.iter().zip(batch.x).zip(batch.y).zip(batch.on) {
            self.put(x, y, t_us, on);
        }
    }

    /// Lays a frame of the sensor's own pixels under the events.
    fn frame(&mut self, frame: ApsFrame) {
        let bits = u32::from(frame.bits.clamp(1, 16));
        let channels = usize::from(frame.channels.max(1));
        let grey = |x: u16, y: u16| {
            if x >= frame.width || y >= frame.height {
                return 0;
            }
            let at = (usize::from(y) * usize::from(frame.width) + usize::from(x)) * channels;
            let pixels = frame.pixels.get(at..at + channels.min(3)).unwrap_or_default();
            let sum: u32 = pixels.iter().map(|&pixel| u32::from(pixel)).sum();
            (sum / pixels.len().max(1) as u32 * 255 / ((1 << bits) - 1)).min(255) as u8
        };
        let rows = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        self.under = Some(rows.map(|(x, y)| grey(x, y)).collect());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel(rgb: &[u8], width: usize, x: usize, y: usize) -> [u8; 3] {
        let at = 3 * (y * width + x);
        [rgb[at], rgb[at + 1], rgb[at + 2]]
    }

    const BLACK: [u8; 3] = [16, 19, 26];

    #[test]
    fn what_lies_within_the_span_shows_and_what_is_older_does_not() {
        let mut picture = EventPicture::new(SensorSize { width: 8, height: 4 });
        for (t_us, x, y, on) in [(1000, 0, 0, true), (9000, 1, 0, true), (10_000, 2, 0, false), (10_000, 8, 4, true)] {
            picture.event(CdEvent { t_us, x, y, on });
        }
        assert_eq!((picture.events(), picture.newest_us()), (4, Some(10_000)));
        let rgb = picture.render(10_000, 5000, 1);
        assert_eq!(rgb.len(), 3 * 8 * 4);
        assert_eq!(pixel(&rgb, 8, 0, 0), BLACK, "9 ms old");
        assert!(pixel(&rgb, 8, 1, 0)[0] > 200, "ON is warm: {:?}", pixel(&rgb, 8, 1, 0));
        assert_eq!(pixel(&rgb, 8, 2, 0), [66, 150, 255], "OFF is blue, and the newest shows fully");
        assert!(pixel(&picture.render(10_000, 20_000, 1), 8, 0, 0)[0] > 100, "a longer span shows it");
        assert_eq!(pixel(&picture.render(90_000, 5000, 1), 8, 2, 0), BLACK, "time goes on without events");
        picture.clear();
        assert!(picture.render(10_000, 20_000, 1).chunks(3).all(|pixel| pixel == BLACK));
    }

    #[test]
    fn smaller_pictures_keep_every_event() {
        let mut picture = EventPicture::new(SensorSize { width: 9, height: 5 });
        picture.event(CdEvent { t_us: 5, x: 3, y: 1, on: true });
        let rgb = picture.render(5, 1000, 2);
        assert_eq!(rgb.len(), 3 * 4 * 2);
        assert_eq!(pixel(&rgb, 4, 1, 0), [255, 214, 138]);
    }

    #[test]
    fn a_frame_of_any_shape_lies_under_the_events() {
        let mut picture = EventPicture::new(SensorSize { width: 4, height: 2 });
        let frame = |channels: u8, pixels: Vec<u16>| ApsFrame {
            exposure_start_us: 0,
            exposure_end_us: 1,
            width: 2,
            height: 2,
            channels,
            pixels,
            bits: 8,
        };
        picture.frame(frame(1, vec![255, 0, 100, 50]));
        let rgb = picture.render(0, 1, 1);
        assert_eq!((pixel(&rgb, 4, 0, 0), pixel(&rgb, 4, 3, 1)), ([178; 3], [0; 3]));
        picture.frame(frame(3, vec![30, 60, 90, 1]));
        assert_eq!(pixel(&picture.render(0, 1, 1), 4, 0, 0), [42; 3]);
    }
}
