//! PSNR and DPSNR.

use super::{MetricError, Picture, check_length};

/// The PSNR of an exact picture, dB: mean squared errors below 1e-10 count as 1e-10, so that means stay finite.
pub const MAX_PSNR: f64 = 100.0;

fn decibels(mean_squared_error: f64) -> f64 {
    // `min` would hide a not-a-number; `clamp` keeps it.
    (-10.0 * mean_squared_error.log10()).clamp(f64::NEG_INFINITY, MAX_PSNR)
}

/// PSNR of one picture against another, dB: the mean squared error is over all pixels and channels.
///
/// # Errors
/// [`MetricError::Sizes`].
pub fn psnr(a: Picture<'_>, b: Picture<'_>) -> Result<f64, MetricError> {
    a.same_size(b)?;
    let sum: f64 = a.rgb.iter().zip(b.rgb).map(|(&a, &b)| square(a, b)).sum();
    Ok(decibels(sum / a.rgb.len() as f64))
}

fn square(a: f32, b: f32) -> f64 {
    let difference = f64::from(a) - f64::from(b);
    difference * difference
}

/// The squared error of one frame over its moving pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaskedError {
    /// Sum of squared errors over moving pixels and three channels.
    pub sum: f64,
    /// How many pixels move.
    pub pixels: u64,
}

impl MaskedError {
    /// `-10 log10(sum / (3 pixels))`, dB; nothing where no pixel moves.
    #[must_use]
    pub fn psnr(&self) -> Option<f64> {
        (self.pixels > 0).then(|| decibels(self.sum / (3 * self.pixels) as f64))
    }
}

/// The squared error over the pixels where `mask` (one value a pixel) is set.
///
/// # Errors
/// [`MetricError::Sizes`] and [`MetricError::Length`].
pub fn masked_error(a: Picture<'_>, b: Picture<'_>, mask: &[bool]) -> Result<MaskedError, MetricError> {
    a.same_size(b)?;
    check_length(a.width, a.height, 1, mask.len())?;
    let mut error = MaskedError::default();
    for ((a, b), &moves) in a.rgb.as_chunks::<3>().0.iter().zip(b.rgb.as_chunks::<3>().0).zip(mask) {
        if moves {
            error.pixels += 1;
            error.sum += a.iter().zip(b).map(|(&a, &b)| square(a, b)).sum::<f64>();
        }
    }
    Ok(error)
}

/// Collects the masked errors of frames into DPSNR, the PSNR over moving pixels.
#[derive(Clone, Debug, Default)]
pub struct Dpsnr {
    decibels: f64,
    frames: u64,
    pooled: MaskedError,
}

impl Dpsnr {
    /// Adds a frame. One without moving pixels changes nothing.
    pub fn add(&mut self, error: MaskedError) {
        if let Some(decibels) = error.psnr() {
            self.decibels += decibels;
            self.frames += 1;
            self.pooled.sum += error.sum;
            self.pooled.pixels += error.pixels;
        }
    }

    /// Mean over frames with moving pixels of each frame's value, dB.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        (self.frames > 0).then(|| self.decibels / self.frames as f64)
    }

    /// The value over the moving pixels of all frames together, dB.
    #[must_use]
    pub fn pooled(&self) -> Option<f64> {
        self.pooled.psnr()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_error_of_a_tenth_is_20_decibels() {
        let (a, b) = ([0.5; 12], [0.6; 12]);
        let value = psnr(Picture::new(2, 2, &a).unwrap(), Picture::new(2, 2, &b).unwrap()).unwrap();
        assert!((value - 20.0).abs() < 1e-5, "{value}");
    }

    #[test]
    fn an_exact_picture_has_the_greatest_value_and_a_nan_is_not_hidden() {
        let a = [0.25; 12];
        let exact = Picture::new(2, 2, &a).unwrap();
        assert_eq!(psnr(exact, exact).unwrap(), MAX_PSNR);
        let mut b = a;
        b[3] = f32::NAN;
        assert!(psnr(exact, Picture::new(2, 2, &b).unwrap()).unwrap().is_nan());
    }

    #[test]
    fn only_moving_pixels_count_and_still_frames_are_left_out() {
        let truth = [0.0; 6];
        let render = [0.1, 0.1, 0.1, 1.0, 1.0, 1.0];
        let (truth, render) = (Picture::new(2, 1, &truth).unwrap(), Picture::new(2, 1, &render).unwrap());
        let first = masked_error(render, truth, &[true, false]).unwrap();
        let both = masked_error(render, truth, &[true, true]).unwrap();
        let none = masked_error(render, truth, &[false, false]).unwrap();
        assert!((first.psnr().unwrap() - 20.0).abs() < 1e-5);
        assert_eq!(none.psnr(), None);

        let mut dpsnr = Dpsnr::default();
        assert_eq!((dpsnr.mean(), dpsnr.pooled()), (None, None));
        for error in [first, both, none] {
            dpsnr.add(error);
        }
        let expected_mean = (20.0 - 10.0 * (1.01f64 / 2.0).log10()) / 2.0;
        let expected_pooled = -10.0 * ((0.01 + 1.01) / 3.0f64).log10();
        assert!((dpsnr.mean().unwrap() - expected_mean).abs() < 1e-5);
        assert!((dpsnr.pooled().unwrap() - expected_pooled).abs() < 1e-5);
    }

    #[test]
    fn sizes_must_agree() {
        let data = [0.0; 12];
        let (wide, square) = (Picture::new(4, 1, &data).unwrap(), Picture::new(2, 2, &data).unwrap());
        assert!(matches!(psnr(wide, square), Err(MetricError::Sizes { .. })));
        assert!(matches!(masked_error(square, square, &[true; 3]), Err(MetricError::Length { .. })));
    }
}
