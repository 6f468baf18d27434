//! Printed boards that move before an event camera.
//!
//! A leaky integral of the events ([`Leaky`]) shows what has just moved as a picture, at any instant and without blur. Where the
//! board moves, corners are found in it as in a frame. Edges along which the board moves make no events, but what lies on either
//! side of them does, and differently.

use erfgs_events::{CdEvent, Event};
use erfgs_scene::ImageRgb8;

use crate::intensity::{Leaky, LogIntensity};

/// How often the picture is looked at in a second of the stream.
const LOOKS_HZ: i64 = 20;
/// What is older than 160 ms is forgotten: with longer memory thresholds that differ between ON and OFF add up to speckles, with
/// shorter one a slow board fades before its next edge comes.
const CUTOFF_HZ: f64 = 1.0;
/// The scale of the picture, which is stretched afterwards.
const THRESHOLD: f64 = 0.2;
/// What varies more slowly than the sensor's width divided by this is no board.
const SLOW: u32 = 16;
/// With fewer events (share of the pixels) since the last look nothing moved.
const LEAST_EVENTS: f64 = 0.02;
/// A board that moved less than this (root mean square over its corners, share of the sensor's width) since the last view adds nothing.
pub(super) const MOVED: f64 = 0.03;

/// Makes pictures of a stream. `found` gets the time of each picture, microseconds, and the picture.
#[derive(Clone)]
pub(super) struct Looks {
    integral: Leaky,
    size: [u32; 2],
    next_us: Option<i64>,
    fresh: usize,
}

impl Looks {
    pub fn new([width, height]: [usize; 2]) -> Self {
        let size = [width as u32, height as u32];
        Self { integral: Leaky::new(size[0], size[1], THRESHOLD, CUTOFF_HZ), size, next_us: None, fresh: 0 }
    }

    pub fn event(&mut self, event: CdEvent, found: &mut dyn FnMut(i64, ImageRgb8)) {
        const PERIOD_US: i64 = 1_000_000 / LOOKS_HZ;
        let t_us = event.t_us as i64;
        // At the same times in the streams of all cameras.
        let after = |t_us: i64| (t_us / PERIOD_US + 1).saturating_mul(PERIOD_US);
        let next = *self.next_us.get_or_insert(after(t_us));
        if t_us >= next {
            let [width, height] = self.size;
            if self.fresh as f64 >= LEAST_EVENTS * f64::from(width) * f64::from(height) {
                found(next, picture(&self.integral.at(next), width / SLOW));
            }
            (self.next_us, self.fresh) = (Some(after(t_us)), 0);
        }
        self.integral.push(Event { t_us, x: event.x, y: event.y, on: event.on });
        self.fresh += 1;
    }
}

/// In grey, softened over three pixels against the speckles of single ones.
fn picture(seen: &LogIntensity, radius_px: u32) -> ImageRgb8 {
    let grey = seen.picture(radius_px.max(2));
    let (width, height) = (grey.width as usize, grey.height as usize);
    let mut image = ImageRgb8::new(grey.width, grey.height);
    for (index, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = (index % width, index / width);
        let (mut sum, mut count) = (0, 0);
        for row in y.saturating_sub(1)..(y + 2).min(height) {
            for column in x.saturating_sub(1)..(x + 2).min(width) {
                // The middle counts four times, its neighbours twice, the corners once.
                let weight = (2 - row.abs_diff(y)) * (2 - column.abs_diff(x));
                sum += weight * usize::from(grey.data[row * width + column]);
                count += weight;
            }
        }
        pixel.fill((sum / count) as u8);
    }
    image
}
