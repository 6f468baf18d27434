//! Matching of two images whose poses are not known: every feature with every other.
//!
//! COLMAP does the same; here it is a matrix product, which takes a fraction of the time of version 3.8 without a GPU, and
//! gives every version the same matches.

use nalgebra::DMatrix;

use super::matching::{Best, DESCRIPTOR};

/// Features of the first image that are compared at once.
const ROWS: usize = 256;

/// The descriptors of an image, each of length 1, as columns.
#[derive(Clone, Debug)]
pub struct Descriptors {
    columns: DMatrix<f32>,
}

impl Descriptors {
    /// Of COLMAP's bytes.
    pub fn new(descriptors: &[[u8; DESCRIPTOR]]) -> Self {
        let mut columns = DMatrix::zeros(DESCRIPTOR, descriptors.len());
        for (mut column, descriptor) in columns.column_iter_mut().zip(descriptors) {
            for (to, &from) in column.iter_mut().zip(descriptor) {
                *to = f32::from(from);
            }
            let length = column.norm();
            if length > 0.0 {
                column /= length;
            }
        }
        Self { columns }
    }

    /// Pairs of features that are each other's nearest, nearer than the second nearest by `ratio` (of angles) in both
    /// directions, and nearer than `max_angle` radians.
    pub fn matches(&self, other: &Self, ratio: f64, max_angle: f64) -> Vec<[u32; 2]> {
        let (n, m) = (self.columns.ncols(), other.columns.ncols());
        let mut rows = vec![Best::NONE; n];
        let mut columns = vec![Best::NONE; m];
        for from in (0..n).step_by(ROWS) {
            let count = ROWS.min(n - from);
            let similarity = self.columns.columns(from, count).transpose() * &other.columns;
            for (j, column) in similarity.column_iter().enumerate() {
                let best = &mut columns[j];
                for (i, &value) in column.iter().enumerate() {
                    best.offer(value, (from + i) as u32);
                    rows[from + i].offer(value, j as u32);
                }
            }
        }
        let good = |best: &Best| best.accepted(ratio, max_angle);
        rows.iter()
            .enumerate()
            .filter(|(_, best)| good(best))
            .map(|(i, best)| [i as u32, best.index])
            .filter(|&[i, j]| columns[j as usize].index == i && good(&columns[j as usize]))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random::{below, key};

    use super::*;

    #[test]
    fn features_find_their_noisy_copies_and_nothing_else() {
        let descriptor = |id: u64, noise: u64| -> [u8; DESCRIPTOR] {
            std::array::from_fn(|k| {
                let value = below(key(1, &[id, k as u64]), 120) + below(key(2, &[id, k as u64, noise]), 8);
                value as u8
            })
        };
        let a: Vec<_> = (0..600).map(|id| descriptor(id, 1)).collect();
        // The second image has every third of them, in reverse, and some of its own.
        let b: Vec<_> =
            (0..200).rev().map(|id| descriptor(3 * id, 2)).chain((900..950).map(|id| descriptor(id, 3))).collect();
        let found = Descriptors::new(&a).matches(&Descriptors::new(&b), 0.8, 0.7);
        let expected: Vec<[u32; 2]> = (0..200).map(|id| [3 * id, 199 - id]).collect();
        assert_eq!(found, expected);
        assert!(Descriptors::new(&a).matches(&Descriptors::new(&[]), 0.8, 0.7).is_empty());
    }
}
