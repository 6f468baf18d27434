//! Pictures as a lens without distortion would have taken them.
//!
//! So that no pixel is made up, the focal length is enlarged where the pinhole would see what the lens did not.

use glam::DVec2;

use crate::{Distortion, ImageGrey8, ImageRgb8, Intrinsics};

/// Focal lengths are enlarged up to this factor before a lens counts as one that no pinhole can replace.
const LARGEST_FACTOR: f64 = 16.0;

/// No pinhole replaces a lens: even a much longer focal length sees what the lens does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no pinhole camera can replace this lens")]
pub struct NoPinhole;

/// The pinhole that replaces a lens, and the factor by which its focal length was enlarged so that the lens saw all
/// that the pinhole sees.
///
/// # Errors
/// If even a much longer focal length does not help.
pub fn pinhole(from: &Intrinsics) -> Result<(Intrinsics, f64), NoPinhole> {
    if from.distortion == Distortion::None {
        return Ok((*from, 1.0));
    }
    let scaled =
        |factor: f64| Intrinsics { fx: from.fx * factor, fy: from.fy * factor, distortion: Distortion::None, ..*from };
    if sees_all(from, &scaled(1.0)) {
        return Ok((scaled(1.0), 1.0));
    }
    let (mut short, mut long) = (1.0, LARGEST_FACTOR);
    if !sees_all(from, &scaled(long)) {
        return Err(NoPinhole);
    }
    while long - short > 1e-4 {
        let middle = 0.5 * (short + long);
        if sees_all(from, &scaled(middle)) { long = middle } else { short = middle }
    }
    Ok((scaled(long), long))
}

/// Whether the lens has an image of every pixel on the border of `to`, and so of all within.
fn sees_all(from: &Intrinsics, to: &Intrinsics) -> bool {
    let [width, height] = [to.width, to.height].map(f64::from);
    let columns =
        (0..to.width).map(|x| f64::from(x) + 0.5).flat_map(|x| [DVec2::new(x, 0.5), DVec2::new(x, height - 0.5)]);
    let rows =
        (0..to.height).map(|y| f64::from(y) + 0.5).flat_map(|y| [DVec2::new(0.5, y), DVec2::new(width - 0.5, y)]);
    let seen = |pixel: DVec2| {
        let source = from.project(to.unproject_pinhole(pixel, 1.0))?;
        // Between the centres of the outermost pixels nothing needs to be made up; rounding gets a hair's breadth.
        let inside = |value: f64, size: f64| (0.5 - 1e-6..=size - 0.5 + 1e-6).contains(&value);
        (inside(source.x, width) && inside(source.y, height)).then_some(())
    };
    columns.chain(rows).all(|pixel| seen(pixel).is_some())
}

/// Where each pixel of `to`, row by row, lies in images of `from` (pixels; centres at half-integers).
fn pixel_map(from: &Intrinsics, to: &Intrinsics) -> Vec<DVec2> {
    let pixels = (0..to.height).flat_map(|y| (0..to.width).map(move |x| (x, y)));
    let centre = |(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
    // Within the border that `sees_all` checked every ray has an image; a lens that folds inside it shows its corner.
    pixels.map(|pixel| from.project(to.unproject_pinhole(centre(pixel), 1.0)).unwrap_or(DVec2::ZERO)).collect()
}

/// Samples an image of `C` interleaved channels bilinearly at every position of `map`; outside, the border goes on.
fn sample<const C: usize>(map: &[DVec2], data: &[u8], width: u32, height: u32) -> Vec<u8> {
    let mut out = Vec::with_capacity(map.len() * C);
    let clamp = |value: f64, size: u32| value.clamp(0.0, f64::from(size.max(1) - 1));
    let value = |x: usize, y: usize, channel: usize| {
        f64::from(data.get((y * width as usize + x) * C + channel).copied().unwrap_or(0))
    };
    for position in map {
        let (x, y) = (clamp(position.x - 0.5, width), clamp(position.y - 0.5, height));
        let (left, top) = (x.floor() as usize, y.floor() as usize);
        let (right, bottom) = ((x.ceil() as usize), (y.ceil() as usize));
        let (u, v) = (x.fract(), y.fract());
        for channel in 0..C {
            let above = value(left, top, channel) * (1.0 - u) + value(right, top, channel) * u;
            let below = value(left, bottom, channel) * (1.0 - u) + value(right, bottom, channel) * u;
            out.push((above * (1.0 - v) + below * v).round() as u8);
        }
    }
    out
}

/// Takes pictures of a lens over to a pinhole.
pub struct Undistortion {
    to: Intrinsics,
    /// Where each pixel of `to` lies; `None` where there is nothing to do.
    map: Option<Vec<DVec2>>,
}

impl Undistortion {
    /// From a lens to `to` (see [`pinhole`]).
    #[must_use]
    pub fn new(from: &Intrinsics, to: &Intrinsics) -> Self {
        Self { to: *to, map: (from != to).then(|| pixel_map(from, to)) }
    }

    /// An image as the pinhole sees it, resampled bilinearly.
    #[must_use]
    pub fn picture(&self, image: &ImageRgb8) -> ImageRgb8 {
        let Some(map) = &self.map else { return image.clone() };
        let data = sample::<3>(map, &image.data, image.width, image.height);
        ImageRgb8 { width: self.to.width, height: self.to.height, data }
    }

    /// A mask as the pinhole sees it: what is white by half or more is white.
    #[must_use]
    pub fn mask(&self, mask: &ImageGrey8) -> ImageGrey8 {
        if self.map.is_none() { mask.clone() } else { self.grey(mask).binarised() }
    }

    /// A grey image as the pinhole sees it, resampled bilinearly.
    #[must_use]
    pub fn grey(&self, image: &ImageGrey8) -> ImageGrey8 {
        let Some(map) = &self.map else { return image.clone() };
        let data = sample::<1>(map, &image.data, image.width, image.height);
        ImageGrey8 { width: self.to.width, height: self.to.height, data }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(distortion: Distortion) -> Intrinsics {
        Intrinsics { width: 64, height: 48, fx: 60.0, fy: 58.0, cx: 33.0, cy: 23.5, distortion }
    }

    const BARREL: Distortion = Distortion::BrownConrady([-0.2, 0.02, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
    const PINCUSHION: Distortion = Distortion::BrownConrady([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);

    #[test]
    fn the_focal_length_grows_only_where_the_lens_saw_too_little() {
        assert_eq!(pinhole(&lens(Distortion::None)).unwrap().1, 1.0);
        assert_eq!(pinhole(&lens(BARREL)).unwrap().1, 1.0);
        let (to, factor) = pinhole(&lens(PINCUSHION)).unwrap();
        assert!((1.05..1.3).contains(&factor), "{factor}");
        assert!(sees_all(&lens(PINCUSHION), &to));
        let shorter = Intrinsics { fx: to.fx * 0.999, fy: to.fy * 0.999, ..to };
        assert!(!sees_all(&lens(PINCUSHION), &shorter), "no longer than needed");
        let folded = lens(Distortion::BrownConrady([-500.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        assert_eq!(pinhole(&folded).unwrap_err(), NoPinhole);
    }
}
