//! Pictures for the page: small, and cheap to make.

use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};

/// Widest preview, pixels.
const WIDEST: u32 = 640;
/// Quality of previews.
const QUALITY: u8 = 80;
/// How much of the last picture's events remains in the next.
const FADE: f32 = 0.45;
/// Colours of an untouched pixel, of rising and of falling intensity.
const STILL: [f32; 3] = [16.0, 19.0, 26.0];
const ON: [f32; 3] = [255.0, 214.0, 138.0];
const OFF: [f32; 3] = [66.0, 150.0, 255.0];

/// An 8-bit RGB picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
}

impl Picture {
    /// A picture whose pixel (column, row) is what `pixel` gives for the matching place of an image of `width` x
    /// `height`, made smaller by a whole factor where that is too wide.
    pub fn shrunk(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Self {
        let step = width.div_ceil(WIDEST).max(1);
        let (small_width, small_height) = (width / step, height / step);
        let mut rgb = Vec::with_capacity(3 * (small_width * small_height) as usize);
        for y in 0..small_height {
            for x in 0..small_width {
                rgb.extend_from_slice(&pixel(x * step, y * step));
            }
        }
        Self { width: small_width, height: small_height, rgb }
    }

    /// JPEG; `None` if the picture is empty.
    pub fn jpeg(&self) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
        encoder.write_image(&self.rgb, self.width, self.height, ExtendedColorType::Rgb8).ok()?;
        Some(bytes)
    }
}

/// Events accumulated to a picture, which goes on from one picture to the next: what the light did fades, where it came and
/// went nothing remains. Pictures of reports, which stand for themselves, count instead (`calibrate/src/report/events.rs`).
pub(super) struct Canvas {
    step: u16,
    width: u16,
    height: u16,
    balance: Vec<f32>,
    /// Grey picture of the same sensor to draw over, at the canvas' size.
    under: Option<Vec<u8>>,
}

impl Canvas {
    /// A canvas for a sensor of `width` x `height`.
    pub fn new(width: u32, height: u32) -> Self {
        let step = width.div_ceil(WIDEST).max(1);
        let (small_width, small_height) = (width / step, height / step);
        let balance = vec![0.0; (small_width * small_height) as usize];
        // Sensors have at most 2^11 columns.
        Self { step: step as u16, width: small_width as u16, height: small_height as u16, balance, under: None }
    }

    /// Adds an event.
    #[inline]
    pub fn add(&mut self, x: u16, y: u16, on: bool) {
        let (x, y) = (x / self.step, y / self.step);
        if x < self.width && y < self.height {
            let at = usize::from(y) * usize::from(self.width) + usize::from(x);
            self.balance[at] += if on { 1.0 } else { -1.0 };
        }
    }

    /// Lays a frame of the sensor's own pixels, of `bits` significant bits, under the events.
    pub fn lay_under(&mut self, width: u16, height: u16, pixels: &[u16], bits: u8) {
        let at = |x: u16, y: u16| {
            let (x, y) = (x * self.step, y * self.step);
            if x >= width || y >= height {
                return 0;
            }
            let pixel = pixels.get(usize::from(y) * usize::from(width) + usize::from(x)).copied().unwrap_or(0);
            (u32::from(pixel) * 255 / ((1 << bits.clamp(1, 16)) - 1)).min(255) as u8
        };
        let rows = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        self.under = Some(rows.map(|(x, y)| at(x, y)).collect());
    }

    /// The picture of the events since the last one, over what fades of those before.
    pub fn render(&mut self) -> Picture {
        let mut rgb = Vec::with_capacity(3 * self.balance.len());
        for (at, balance) in self.balance.iter_mut().enumerate() {
            let base = match &self.under {
                Some(under) => [f32::from(under.get(at).copied().unwrap_or(0)) * 0.7; 3],
                None => STILL,
            };
            // One event shows clearly; from four on a pixel is saturated.
            let weight = (balance.abs() * 0.45).min(1.0);
            let colour = if *balance > 0.0 { ON } else { OFF };
            rgb.extend((0..3).map(|channel| (base[channel] + weight * (colour[channel] - base[channel])) as u8));
            *balance *= FADE;
            if balance.abs() < 0.05 {
                *balance = 0.0;
            }
        }
        Picture { width: self.width.into(), height: self.height.into(), rgb }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_colour_their_pixel_and_fade() {
        let mut canvas = Canvas::new(1280, 720);
        canvas.add(100, 50, true);
        canvas.add(101, 51, true);
        canvas.add(1279, 719, false);
        canvas.add(2047, 2047, true);
        let first = canvas.render();
        assert_eq!((first.width, first.height), (640, 360));
        let pixel = |picture: &Picture, x: usize, y: usize| {
            let at = 3 * (y * 640 + x);
            [picture.rgb[at], picture.rgb[at + 1], picture.rgb[at + 2]]
        };
        assert!(pixel(&first, 50, 25)[0] > 200, "ON is warm: {:?}", pixel(&first, 50, 25));
        assert!(pixel(&first, 639, 359)[2] > 100 && pixel(&first, 639, 359)[0] < 60, "OFF is blue");
        let second = canvas.render();
        assert!(pixel(&second, 50, 25)[0] < pixel(&first, 50, 25)[0]);
        for _ in 0..10 {
            canvas.render();
        }
        assert_eq!(pixel(&canvas.render(), 50, 25), [16, 19, 26]);
    }

    #[test]
    fn wide_images_shrink_by_a_whole_factor() {
        let picture = Picture::shrunk(1920, 1080, |x, y| [(x / 8) as u8, (y / 8) as u8, 7]);
        assert_eq!((picture.width, picture.height), (640, 360));
        assert_eq!(picture.rgb[3 * (640 + 1)..][..3], [0, 0, 7]);
        assert_eq!(picture.rgb[3 * (100 * 640 + 600)..][..3], [225, 37, 7]);
        assert!(picture.jpeg().is_some_and(|jpeg| jpeg.starts_with(&[0xff, 0xd8])));
    }
}
