//! The moving pixels of a frame, summed so that any rectangle of them is known at once.

use erfgs_scene::image::ImageRgb8;
use glam::DVec2;

/// Where a frame differs from what its camera shows most of the time.
pub struct Silhouette {
    width: u32,
    height: u32,
    /// Moving pixels above and left of each corner of the pixel grid, `(width + 1) * (height + 1)`.
    sums: Vec<u32>,
}

impl Silhouette {
    /// Pixels of which a channel differs by more than `threshold` (1 is white against black), and most of the eight
    /// around them too.
    pub fn new(image: &ImageRgb8, usual: &[[u8; 3]], threshold: f64) -> Self {
        let (width, height) = (image.width, image.height);
        let differs = |x: u32, y: u32| {
            let (now, usual) = (image.pixel(x, y), usual[(y * width + x) as usize]);
            std::iter::zip(now, usual).any(|(a, b)| f64::from(a.abs_diff(b)) > 255.0 * threshold)
        };
        let raw = Self::sum(width, height, differs);
        Self::sum(width, height, |x, y| {
            let [x0, y0] = [x.saturating_sub(1), y.saturating_sub(1)];
            let [x1, y1] = [(x + 2).min(width), (y + 2).min(height)];
            2 * raw.count([x0, y0], [x1, y1]) > (x1 - x0) * (y1 - y0)
        })
    }

    fn sum(width: u32, height: u32, moving: impl Fn(u32, u32) -> bool) -> Self {
        let row = width as usize + 1;
        let mut sums = vec![0; row * (height as usize + 1)];
        for y in 0..height {
            let mut along = 0;
            for x in 0..width {
                along += u32::from(moving(x, y));
                let at = (y as usize + 1) * row + x as usize + 1;
                sums[at] = sums[at - row] + along;
            }
        }
        Self { width, height, sums }
    }

    /// Moving pixels with columns and rows from `low` up to but not with `high`.
    fn count(&self, low: [u32; 2], high: [u32; 2]) -> u32 {
        let at = |x: u32, y: u32| self.sums[y as usize * (self.width as usize + 1) + x as usize];
        at(high[0], high[1]) + at(low[0], low[1]) - at(low[0], high[1]) - at(high[0], low[1])
    }

    /// Whether any pixel within the square of half-side `radius_px` around a position moves.
    pub fn any(&self, at: DVec2, radius_px: f64) -> bool {
        let low = |value: f64| (value - radius_px).max(0.0) as u32;
        let high = |value: f64, size: u32| ((value + radius_px).max(0.0) as u32 + 1).min(size);
        let (x, y) = ([low(at.x), high(at.x, self.width)], [low(at.y), high(at.y, self.height)]);
        x[0] < x[1] && y[0] < y[1] && self.count([x[0], y[0]], [x[1], y[1]]) > 0
    }
}
