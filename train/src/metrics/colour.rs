//! Colour that no training camera can know: the affine map from a rendering's colours to a held-out camera's, fitted on
//! what stands still, and the error that is left after it.

use super::{MetricError, Picture, check_length};

/// Sums over pixels of products of a rendering's colours x (with 1 as a fourth) and the truth's y: all that a least-squares
/// fit of y by an affine map of x, and the squared error of any such map, need.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ColourSums {
    xx: [[f64; 4]; 4],
    xy: [[f64; 3]; 4],
    yy: f64,
    pixels: u64,
}

/// An affine map of colours: a row for red, green and blue, applied to (r, g, b, 1).
pub type ColourMap = [[f64; 4]; 3];

impl ColourSums {
    /// The sums over the pixels of a rendering and the truth where `mask` is `wanted`.
    ///
    /// # Errors
    /// [`MetricError::Sizes`] and [`MetricError::Length`].
    pub fn of(rendered: Picture<'_>, truth: Picture<'_>, mask: &[bool], wanted: bool) -> Result<Self, MetricError> {
        rendered.same_size(truth)?;
        check_length(rendered.width, rendered.height, 1, mask.len())?;
        let mut sums = Self::default();
        let pairs = rendered.rgb.as_chunks::<3>().0.iter().zip(truth.rgb.as_chunks::<3>().0);
        for ((rendered, truth), _) in pairs.zip(mask).filter(|(_, mask)| **mask == wanted) {
            let x = [rendered[0].into(), rendered[1].into(), rendered[2].into(), 1.0];
            let y = truth.map(f64::from);
            for (i, &from) in x.iter().enumerate() {
                for (j, &to) in x.iter().enumerate() {
                    sums.xx[i][j] += from * to;
                }
                for (c, &to) in y.iter().enumerate() {
                    sums.xy[i][c] += from * to;
                }
            }
            sums.yy += y.iter().map(|y| y * y).sum::<f64>();
            sums.pixels += 1;
        }
        Ok(sums)
    }

    /// Adds other pixels.
    pub fn add(&mut self, other: &Self) {
        for i in 0..4 {
            for j in 0..4 {
                self.xx[i][j] += other.xx[i][j];
            }
            for c in 0..3 {
                self.xy[i][c] += other.xy[i][c];
            }
        }
        self.yy += other.yy;
        self.pixels += other.pixels;
    }

    /// How many pixels there are.
    #[must_use]
    pub fn pixels(&self) -> u64 {
        self.pixels
    }

    /// The map that makes the squared error least; held to the identity where the pixels say nothing.
    #[must_use]
    pub fn fit(&self) -> ColourMap {
        // As if a ten-thousandth of a pixel for each pixel said that colours are right.
        let held = 1e-4 * (self.pixels.max(1)) as f64;
        let mut normal = glam::DMat4::ZERO;
        for i in 0..4 {
            for j in 0..4 {
                normal.col_mut(j)[i] = self.xx[i][j] + if i == j { held } else { 0.0 };
            }
        }
        let inverse = normal.inverse();
        std::array::from_fn(|channel| {
            let right = glam::DVec4::from_array(std::array::from_fn(|i| {
                self.xy[i][channel] + if i == channel { held } else { 0.0 }
            }));
            (inverse * right).to_array()
        })
    }

    /// The sum of squared errors over pixels and channels after `map`.
    #[must_use]
    pub fn error(&self, map: &ColourMap) -> f64 {
        let mut error = self.yy;
        for (channel, row) in map.iter().enumerate() {
            for i in 0..4 {
                error -= 2.0 * row[i] * self.xy[i][channel];
                for j in 0..4 {
                    error += row[i] * row[j] * self.xx[i][j];
                }
            }
        }
        error.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(count: usize) -> Vec<f32> {
        (0..count as u64).map(|i| erfgs_base::random::uniform(erfgs_base::random::key(5, &[i])) as f32).collect()
    }

    #[test]
    fn the_error_after_a_map_is_that_of_the_mapped_picture() {
        let (x, y) = (noise(48), noise(96)[48..].to_vec());
        let (a, b) = (Picture::new(4, 4, &x).unwrap(), Picture::new(4, 4, &y).unwrap());
        let mask: Vec<bool> = (0..16).map(|i| i % 3 == 0).collect();
        let map = [[0.9, 0.1, -0.2, 0.05], [0.0, 1.1, 0.1, -0.1], [0.2, 0.0, 0.8, 0.0]];
        let sums = ColourSums::of(a, b, &mask, false).unwrap();
        assert_eq!(sums.pixels(), 10);
        let mut expected = 0.0;
        for (at, _) in mask.iter().enumerate().filter(|(_, moves)| !**moves) {
            for (channel, row) in map.iter().enumerate() {
                let mapped: f64 = (0..3).map(|i| row[i] * f64::from(x[3 * at + i])).sum::<f64>() + row[3];
                expected += (mapped - f64::from(y[3 * at + channel])).powi(2);
            }
        }
        assert!((sums.error(&map) - expected).abs() < 1e-9 * expected);
    }

    #[test]
    fn a_camera_of_another_colour_is_found_and_nothing_is_made_of_nothing() {
        let x = noise(300);
        let map = [[0.95, 0.02, 0.0, 0.03], [0.0, 1.05, -0.02, -0.02], [0.01, 0.0, 0.9, 0.05]];
        let y: Vec<f32> = x
            .chunks_exact(3)
            .flat_map(|x| map.map(|row| ((0..3).map(|i| row[i] * f64::from(x[i])).sum::<f64>() + row[3]) as f32))
            .collect();
        let (a, b) = (Picture::new(10, 10, &x).unwrap(), Picture::new(10, 10, &y).unwrap());
        let sums = ColourSums::of(a, b, &[false; 100], false).unwrap();
        let found = sums.fit();
        for (found, map) in found.as_flattened().iter().zip(map.as_flattened()) {
            assert!((found - map).abs() < 5e-3, "{found} instead of {map}");
        }
        assert!(sums.error(&found) < 1e-3 * sums.error(&ColourSums::default().fit()));
        let identity = ColourSums::default().fit();
        assert!((identity[1][1] - 1.0).abs() < 1e-9 && identity[0][3].abs() < 1e-9);
    }
}
