//! Bright spots in a frame.

use erfgs_scene::ImageGrey8;

use super::{
    Light,
    spot::{Sample, spots},
};

/// What counts as a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrightOptions {
    /// A pixel counts if it is so far from the median of the image towards its brightest pixel, 0 to 1.
    pub level: f64,
    /// A light is at least so much brighter than the median, of 255.
    pub least_contrast: f64,
    /// A light of fewer pixels is none.
    pub least_pixels: usize,
    /// If more than this share of the image is bright, nothing is a light.
    pub most_share: f64,
}

impl Default for BrightOptions {
    fn default() -> Self {
        Self { level: 0.5, least_contrast: 60.0, least_pixels: 4, most_share: 0.01 }
    }
}

/// The bright spots of an image, the strongest first, at most eight; pixels weigh with their brightness above the level.
#[must_use]
pub fn bright_lights(image: &ImageGrey8, options: &BrightOptions) -> Vec<Light> {
    let mut histogram = [0_usize; 256];
    for value in &image.data {
        histogram[usize::from(*value)] += 1;
    }
    let total = image.data.len();
    let mut below = 0;
    let median = histogram.iter().position(|count| {
        below += count;
        2 * below >= total.max(1)
    });
    let most = histogram.iter().rposition(|count| *count > 0);
    let (Some(median), Some(most)) = (median, most) else { return Vec::new() };
    let (median, most) = (median as f64, most as f64);
    let level = median + options.level * (most - median);
    let bright = histogram.iter().enumerate().filter(|(value, _)| *value as f64 > level).map(|(_, count)| count);
    if most - median < options.least_contrast || bright.sum::<usize>() as f64 > options.most_share * total as f64 {
        return Vec::new();
    }
    let width = image.width.max(1) as usize;
    let samples: Vec<Sample> = image
        .data
        .iter()
        .enumerate()
        .filter(|(_, value)| f64::from(**value) > level)
        .filter_map(|(index, value)| {
            let (x, y) = (u16::try_from(index % width).ok()?, u16::try_from(index / width).ok()?);
            Some(Sample { x, y, weight: f64::from(*value) - level, t: 0.0 })
        })
        .collect();
    let mut lights = spots(&samples, 1, options.least_pixels);
    lights.truncate(8);
    lights
}
