//! Images as the cloud's makers use them: enlarged grey copies, and colours at a position.

use erfgs_scene::image::{ImageGrey8, ImageRgb8, Resample};
use glam::DVec2;

/// A frame in memory.
#[derive(Clone, Debug)]
pub struct Photo {
    image: ImageRgb8,
}

impl Photo {
    /// Of a decoded image.
    pub fn new(image: ImageRgb8) -> Self {
        Self { image }
    }

    /// Its pixels, as they were decoded.
    pub fn image(&self) -> &ImageRgb8 {
        &self.image
    }

    /// Luma, rounded to 8 bits.
    pub fn grey(&self) -> ImageGrey8 {
        self.image.grey()
    }

    /// Luma of the image enlarged `factor` times.
    pub fn enlarged(&self, factor: u32) -> ImageGrey8 {
        let grey = self.grey();
        grey.resized(grey.width * factor, grey.height * factor, Resample::Lanczos)
    }

    /// The colour at a position in pixels, between the four nearest pixel centres.
    pub fn colour(&self, at: DVec2) -> [u8; 3] {
        let (width, height) = (self.image.width, self.image.height);
        if width == 0 || height == 0 {
            return [0; 3];
        }
        let axis = |value: f64, size: u32| {
            let value = (value - 0.5).clamp(0.0, f64::from(size - 1));
            let low = value.floor();
            let high = (low as u32 + 1).min(size - 1);
            (low as u32, high, value - low)
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (axis(at.x, width), axis(at.y, height));
        let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| self.image.pixel(x, y));
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        std::array::from_fn(|channel| {
            let sum: f64 =
                corners.iter().zip(weights).map(|(corner, weight)| f64::from(corner[channel]) * weight).sum();
            (sum + 0.5) as u8
        })
    }
}

/// The median of each channel; the lower one of an even number. Grey if there are no colours.
pub fn median_colour(colours: &[[u8; 3]]) -> [u8; 3] {
    if colours.is_empty() {
        return [128; 3];
    }
    std::array::from_fn(|channel| {
        let mut values: Vec<u8> = colours.iter().map(|colour| colour[channel]).collect();
        let middle = (values.len() - 1) / 2;
        *values.select_nth_unstable(middle).1
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_colour_at_a_pixel_centre_is_the_pixel_and_between_two_it_is_their_mean() {
        let data = vec![0, 10, 20, 100, 110, 120, 50, 60, 70, 200, 210, 220];
        let photo = Photo::new(ImageRgb8 { width: 2, height: 2, data });
        assert_eq!(photo.colour(DVec2::new(1.5, 0.5)), [100, 110, 120]);
        assert_eq!(photo.colour(DVec2::new(1.0, 0.5)), [50, 60, 70]);
        assert_eq!(photo.colour(DVec2::new(-3.0, 9.0)), [50, 60, 70], "outside counts as the nearest edge");
    }

    #[test]
    fn the_median_ignores_one_wild_view() {
        assert_eq!(median_colour(&[[10, 20, 30], [12, 18, 33], [255, 0, 0]]), [12, 18, 30]);
        assert_eq!(median_colour(&[[7, 8, 9]]), [7, 8, 9]);
    }
}
