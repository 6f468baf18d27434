//! Image quality: PSNR, DPSNR, SSIM and LPIPS, as the 4DGS evaluation defines them where it is well defined.
//!
//! All functions take pictures as f32 RGB in [0, 1]. The evaluation compares 8-bit pictures, so that what is measured
//! is what is written to disk: see [`erfgs_splat::model::to_bytes`] and [`to_unit`].

mod colour;
mod fast;
mod lpips;
mod motion;
mod psnr;
mod ssim;

pub use colour::{ColourMap, ColourSums};
pub use fast::{Changes, fast_from};
pub use lpips::{Lpips, LpipsError, LpipsWeights};
pub use motion::{MotionMaskOptions, motion_masks};
pub use psnr::{Dpsnr, MAX_PSNR, MaskedError, masked_error, psnr};
pub use ssim::ssim;

/// What can be wrong with the pictures.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetricError {
    /// A picture's data do not fit its size.
    #[error("a picture of {width} x {height} pixels needs {expected} values, but {found} were given")]
    Length {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Values needed.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// The pictures have different sizes.
    #[error(
        "the pictures differ in size ({}x{} and {}x{}); render at the size of the ground truth", a.0, a.1, b.0, b.1
    )]
    Sizes {
        /// Size of one.
        a: (u32, u32),
        /// Size of the other.
        b: (u32, u32),
    },
    /// A picture has no pixels.
    #[error("a picture of {width} x {height} pixels is empty; give one with at least one pixel")]
    Empty {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// The picture is too small for the network.
    #[error("a picture of {width} x {height} pixels is too small for LPIPS; give at least {least} x {least}")]
    TooSmall {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// The least width and height.
        least: u32,
    },
}

/// A picture: `height` rows of `width` pixels of red, green, blue in [0, 1].
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    width: u32,
    height: u32,
    rgb: &'a [f32],
}

impl<'a> Picture<'a> {
    /// From `width * height * 3` values.
    ///
    /// # Errors
    /// [`MetricError::Length`] and [`MetricError::Empty`].
    pub fn new(width: u32, height: u32, rgb: &'a [f32]) -> Result<Self, MetricError> {
        check_length(width, height, 3, rgb.len())?;
        Ok(Self { width, height, rgb })
    }

    fn same_size(self, other: Picture<'_>) -> Result<(), MetricError> {
        if (self.width, self.height) == (other.width, other.height) {
            Ok(())
        } else {
            Err(MetricError::Sizes { a: (self.width, self.height), b: (other.width, other.height) })
        }
    }
}

fn check_length(width: u32, height: u32, channels: usize, found: usize) -> Result<(), MetricError> {
    if width == 0 || height == 0 {
        return Err(MetricError::Empty { width, height });
    }
    let expected = (width as usize).saturating_mul(height as usize).saturating_mul(channels);
    if found == expected { Ok(()) } else { Err(MetricError::Length { width, height, expected, found }) }
}

/// The picture in [0, 1] that 8-bit values stand for.
#[must_use]
pub fn to_unit(bytes: &[u8]) -> Vec<f32> {
    bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect()
}

#[cfg(test)]
mod testing {
    /// `length` repeatable values in [0, 1).
    pub fn noise(seed: u64, length: usize) -> Vec<f32> {
        let mut state = seed;
        (0..length)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 40) as f32 / (1u64 << 24) as f32
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use erfgs_splat::model::to_bytes;

    #[test]
    fn bytes_survive_the_way_through_unit_values() {
        let all: Vec<u8> = (0..=255).collect();
        assert_eq!(to_bytes(&to_unit(&all)), all);
        assert_eq!(to_bytes(&[-1.0, 2.0, f32::NAN, f32::INFINITY]), [0, 255, 0, 255]);
    }

    #[test]
    fn a_picture_of_the_wrong_length_is_refused() {
        assert!(matches!(Picture::new(2, 2, &[0.0; 11]), Err(MetricError::Length { expected: 12, found: 11, .. })));
        assert!(matches!(Picture::new(0, 2, &[]), Err(MetricError::Empty { .. })));
    }
}
