//! Motion blur: the mean of frames.

use std::sync::LazyLock;

use erfgs_scene::{ImageGrey8, ImageRgb8};

use super::{BlurOptions, Rounding};
use crate::simulator::{linear_of_srgb, srgb_of_linear};

/// Sums frames of one size.
pub(super) struct Mean {
    options: BlurOptions,
    width: u32,
    height: u32,
    /// Sum of the encoded levels, or of linear light in units of [`UNIT`].
    sums: Vec<u64>,
    frames: u64,
}

/// Linear light of one level, as an integer, so that the order of the frames cannot matter.
const UNIT: f64 = 1e9;

static LINEAR: LazyLock<[u64; 256]> =
    LazyLock::new(|| std::array::from_fn(|level| (linear_of_srgb(level as f64 / 255.0) * UNIT).round() as u64));

impl Mean {
    pub(super) fn new(options: BlurOptions, width: u32, height: u32) -> Self {
        Self { options, width, height, sums: vec![0; width as usize * height as usize * 3], frames: 0 }
    }

    /// Adds a frame, which must have the size of the others.
    pub(super) fn add(&mut self, image: &ImageRgb8) {
        self.frames += 1;
        for (sum, &level) in self.sums.iter_mut().zip(&image.data) {
            *sum += if self.options.linear_light { LINEAR[usize::from(level)] } else { u64::from(level) };
        }
    }

    /// The mean of the frames added; black where there are none.
    pub(super) fn finish(self) -> ImageRgb8 {
        let mut image = ImageRgb8::new(self.width, self.height);
        let frames = self.frames.max(1);
        for (level, &sum) in image.data.iter_mut().zip(&self.sums) {
            *level = match (self.options.linear_light, self.options.rounding) {
                (false, Rounding::Truncate) => (sum / frames) as u8,
                (false, Rounding::Nearest) => ((2 * sum + frames) / (2 * frames)) as u8,
                (true, rounding) => {
                    let level = srgb_of_linear(sum as f64 / frames as f64 / UNIT) * 255.0;
                    match rounding {
                        // A thousandth of a level covers what decoding and encoding lose on a still pixel.
                        Rounding::Truncate => (level + 1e-3) as u8,
                        Rounding::Nearest => level.round() as u8,
                    }
                }
            };
        }
        image
    }
}

/// What is set in any of the masks.
pub(super) fn union(mut masks: impl Iterator<Item = ImageGrey8>) -> Option<ImageGrey8> {
    let first = masks.next()?;
    Some(masks.fold(first, |mut all, mask| {
        all.data.iter_mut().zip(&mask.data).for_each(|(all, &mask)| *all = mask.max(*all));
        all
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(options: BlurOptions, levels: &[u8]) -> u8 {
        let mut mean = Mean::new(options, 1, 1);
        levels.iter().for_each(|&level| mean.add(&ImageRgb8 { width: 1, height: 1, data: vec![level; 3] }));
        mean.finish().data[1]
    }

    #[test]
    fn encoded_means_are_cut_off_or_rounded() {
        let nearest = BlurOptions { rounding: Rounding::Nearest, ..BlurOptions::default() };
        assert_eq!(mean(BlurOptions::default(), &[10, 11, 11]), 10);
        assert_eq!(mean(nearest, &[10, 11, 11]), 11);
        assert_eq!(mean(BlurOptions::default(), &[255, 255, 255]), 255);
        assert_eq!(mean(nearest, &[0, 255]), 128);
    }

    #[test]
    fn linear_means_keep_still_pixels_and_favour_the_bright() {
        for rounding in [Rounding::Truncate, Rounding::Nearest] {
            let linear = BlurOptions { rounding, linear_light: true, ..BlurOptions::default() };
            for level in 0..=255 {
                assert_eq!(mean(linear, &[level; 3]), level, "{rounding:?}");
            }
            assert!((187..=188).contains(&mean(linear, &[0, 255])), "half the light");
        }
    }

    #[test]
    fn masks_are_united() {
        let mask = |data: [u8; 3]| ImageGrey8 { width: 3, height: 1, data: data.to_vec() };
        let all = union([mask([0, 255, 0]), mask([255, 0, 0])].into_iter()).unwrap();
        assert_eq!(all.data, [255, 255, 0]);
        assert!(union(std::iter::empty()).is_none());
    }
}
