//! Boards that blink on a screen, in the events of a camera that stands still.
//!
//! Where the board is inked, a pixel brightens and darkens once in each period; elsewhere it does not, whatever else goes on in
//! the room. For each window of time the pixels whose changes come at the right rate make a picture of the board, dark where it
//! blinks, in which corners are found as in any other.

use erfgs_events::CdEvent;
use erfgs_scene::ImageRgb8;

/// Share of a period by which a change may come early or late: screens show whole frames only.
const TOLERANCE: f64 = 0.35;
/// Periods in a window.
const PERIODS: f64 = 6.0;
/// Fewer blinking pixels are no board.
const LEAST_PIXELS: usize = 300;

/// One pixel: when it last turned brighter and darker, and how often that came a period after the last time.
#[derive(Clone, Copy)]
struct Pixel {
    turned: [i64; 2],
    on: Option<bool>,
    hits: u16,
}

impl Pixel {
    const NEW: Self = Self { turned: [i64::MIN; 2], on: None, hits: 0 };
}

/// Gathers the windows of a stream. `found` gets the end of each window, microseconds, and its picture.
#[derive(Clone)]
pub(super) struct Windows {
    width: usize,
    height: usize,
    period_us: f64,
    pixels: Vec<Pixel>,
    start: Option<i64>,
}

impl Windows {
    pub fn new([width, height]: [usize; 2], hz: f64) -> Self {
        let pixels = vec![Pixel::NEW; width * height];
        Self { width, height, period_us: 1e6 / hz, pixels, start: None }
    }

    /// Closes the last window.
    pub fn finish(&mut self, found: &mut dyn FnMut(i64, ImageRgb8)) {
        if let Some(start) = self.start.take() {
            self.close(start + (PERIODS * self.period_us) as i64, found);
        }
    }

    fn close(&mut self, end: i64, found: &mut dyn FnMut(i64, ImageRgb8)) {
        // Half of the changes that a window has room for: two each period, the first without one before it.
        let enough = (PERIODS - 1.0) as u16;
        let blinks: Vec<bool> = self.pixels.iter().map(|pixel| pixel.hits >= enough).collect();
        if blinks.iter().filter(|blinks| **blinks).count() >= LEAST_PIXELS {
            found(end, picture(&blinks, self.width, self.height));
        }
        self.pixels.iter_mut().for_each(|pixel| pixel.hits = 0);
    }

    pub fn event(&mut self, event: CdEvent, found: &mut dyn FnMut(i64, ImageRgb8)) {
        let t_us = event.t_us as i64;
        let start = *self.start.get_or_insert(t_us);
        if (t_us - start) as f64 >= PERIODS * self.period_us {
            self.close(t_us, found);
            self.start = Some(t_us);
        }
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        if x >= self.width || y >= self.height {
            return;
        }
        let pixel = &mut self.pixels[y * self.width + x];
        if pixel.on == Some(event.on) {
            return;
        }
        pixel.on = Some(event.on);
        let last = std::mem::replace(&mut pixel.turned[usize::from(event.on)], t_us);
        if last != i64::MIN && ((t_us - last) as f64 / self.period_us - 1.0).abs() <= TOLERANCE {
            pixel.hits = pixel.hits.saturating_add(1);
        }
    }
}

/// Dark where it blinks; softened over three pixels, so that edges have a slope.
fn picture(blinks: &[bool], width: usize, height: usize) -> ImageRgb8 {
    let mut image = ImageRgb8::new(width as u32, height as u32);
    for y in 0..height {
        for x in 0..width {
            let (mut sum, mut count) = (0, 0);
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for column in x.saturating_sub(1)..(x + 2).min(width) {
                    // The middle counts four times, its neighbours twice, the corners once.
                    let weight = (2 - row.abs_diff(y)) * (2 - column.abs_diff(x));
                    sum += weight * if blinks[row * width + column] { 20 } else { 235 };
                    count += weight;
                }
            }
            image.data[3 * (y * width + x)..][..3].fill((sum / count) as u8);
        }
    }
    image
}
