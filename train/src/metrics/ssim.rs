//! SSIM as the 4DGS evaluation computes it.

use rayon::prelude::*;

use super::{MetricError, Picture};

const RADIUS: usize = 5;
const TAPS: usize = 2 * RADIUS + 1;
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;
const CHANNELS: usize = 3;
const MARGIN: usize = RADIUS * CHANNELS;

/// Mean structural similarity of two pictures over all pixels and channels.
///
/// The window is an 11 x 11 Gaussian of sigma 1.5, C1 = 0.01^2 and C2 = 0.03^2 for a range of 1. Outside the picture
/// everything counts as zero, and pixels near the border count like all others; scikit-image and the original
/// MATLAB code leave the border out instead.
///
/// # Errors
/// [`MetricError::Sizes`].
pub fn ssim(a: Picture<'_>, b: Picture<'_>) -> Result<f64, MetricError> {
    a.same_size(b)?;
    let weights = gaussian();
    let (row, height) = (a.width as usize * CHANNELS, a.height as usize);
    let sums: Vec<f64> = (0..height)
        .into_par_iter()
        .map_init(
            || Moments::new(row),
            |moments, y| {
                moments.down(a.rgb, b.rgb, y, height, &weights);
                moments.across_and_compare(&weights)
            },
        )
        .collect();
    // One sum a row, added in order: the result does not depend on the number of threads.
    Ok(sums.iter().sum::<f64>() / (row * height) as f64)
}

fn gaussian() -> [f32; TAPS] {
    let raw: [f64; TAPS] = std::array::from_fn(|tap| {
        let x = tap as f64 - RADIUS as f64;
        (-x * x / (2.0 * 1.5 * 1.5)).exp()
    });
    let sum: f64 = raw.iter().sum();
    raw.map(|weight| (weight / sum) as f32)
}

/// Local moments of one row: a, b, a^2, b^2, ab, blurred down the columns. Each has a margin of zeros on both sides.
/// Red, green and blue stay interleaved: a step of one pixel is a step of three values.
struct Moments {
    rows: [Vec<f32>; 5],
    row: usize,
}

impl Moments {
    fn new(row: usize) -> Self {
        Self { rows: std::array::from_fn(|_| vec![0.0; row + 2 * MARGIN]), row }
    }

    fn down(&mut self, a: &[f32], b: &[f32], y: usize, height: usize, weights: &[f32; TAPS]) {
        let row = self.row;
        let [ma, mb, maa, mbb, mab] = self.rows.each_mut().map(|values| &mut values[MARGIN..MARGIN + row]);
        for moment in [&mut *ma, &mut *mb, &mut *maa, &mut *mbb, &mut *mab] {
            moment.fill(0.0);
        }
        for source in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(height) {
            let weight = weights[source + RADIUS - y];
            let (a, b) = (&a[source * row..][..row], &b[source * row..][..row]);
            for i in 0..row {
                let (wa, wb) = (weight * a[i], weight * b[i]);
                ma[i] += wa;
                mb[i] += wb;
                maa[i] += wa * a[i];
                mbb[i] += wb * b[i];
                mab[i] += wa * b[i];
            }
        }
    }

    fn across_and_compare(&self, weights: &[f32; TAPS]) -> f64 {
        // Blocks that fit in registers: the sums over taps stay there.
        const BLOCK: usize = 8;
        let mut sum = 0.0;
        let mut start = 0;
        while start < self.row {
            let length = BLOCK.min(self.row - start);
            let mut local = [[0.0f32; BLOCK]; 5];
            for (local, moment) in local.iter_mut().zip(&self.rows) {
                for (tap, &weight) in weights.iter().enumerate() {
                    let source = &moment[start + tap * CHANNELS..][..length];
                    for (local, &value) in local.iter_mut().zip(source) {
                        *local += weight * value;
                    }
                }
            }
            let [ma, mb, maa, mbb, mab] = local;
            for i in 0..length {
                let (aa, bb, ab) = (ma[i] * ma[i], mb[i] * mb[i], ma[i] * mb[i]);
                let structure = (2.0 * ab + C1) * (2.0 * (mab[i] - ab) + C2);
                let energy = (aa + bb + C1) * ((maa[i] - aa) + (mbb[i] - bb) + C2);
                sum += f64::from(structure / energy);
            }
            start += BLOCK;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::testing::noise;

    /// The definition, in f64, window by window.
    fn plain(a: &[f32], b: &[f32], width: usize, height: usize) -> f64 {
        let weight = |d: i64| (-(d * d) as f64 / 4.5).exp();
        let norm: f64 = (-5..=5).map(weight).sum();
        let mut total = 0.0;
        for y in 0..height as i64 {
            for x in 0..width as i64 {
                for c in 0..3 {
                    let mut m = [0.0; 5];
                    for dy in -5..=5 {
                        for dx in -5..=5 {
                            let (px, py) = (x + dx, y + dy);
                            if px < 0 || py < 0 || px >= width as i64 || py >= height as i64 {
                                continue;
                            }
                            let i = (py as usize * width + px as usize) * 3 + c;
                            let w = weight(dx) * weight(dy) / (norm * norm);
                            let (a, b) = (f64::from(a[i]), f64::from(b[i]));
                            for (m, v) in m.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                                *m += w * v;
                            }
                        }
                    }
                    let [ma, mb, maa, mbb, mab] = m;
                    total += (2.0 * ma * mb + 1e-4) * (2.0 * (mab - ma * mb) + 9e-4)
                        / ((ma * ma + mb * mb + 1e-4) * (maa - ma * ma + mbb - mb * mb + 9e-4));
                }
            }
        }
        total / (width * height * 3) as f64
    }

    #[test]
    fn it_is_the_definition_also_where_the_window_exceeds_the_picture() {
        for (width, height) in [(1, 1), (3, 2), (7, 5), (37, 23)] {
            let (a, n) = (noise(1, width * height * 3), noise(2, width * height * 3));
            let b: Vec<f32> = a.iter().zip(&n).map(|(a, n)| 0.8 * a + 0.2 * n).collect();
            let picture = |data| Picture::new(width as u32, height as u32, data).unwrap();
            let (got, expected) = (ssim(picture(&a), picture(&b)).unwrap(), plain(&a, &b, width, height));
            assert!((got - expected).abs() < 2e-6, "{width}x{height}: {got} against {expected}");
        }
    }

    #[test]
    fn a_picture_is_like_itself_and_black_like_black() {
        let a = noise(3, 30 * 20 * 3);
        let picture = Picture::new(30, 20, &a).unwrap();
        assert!((ssim(picture, picture).unwrap() - 1.0).abs() < 1e-6);
        let black = vec![0.0; 30 * 20 * 3];
        let black = Picture::new(30, 20, &black).unwrap();
        assert!((ssim(black, black).unwrap() - 1.0).abs() < 1e-6);
    }
}
