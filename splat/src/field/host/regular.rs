//! The regularisers of the planes on the host.

use rayon::prelude::*;

use crate::field::{Layout, PlaneLosses, PlaneWeights, SpatialSmoothness};

/// The taps of a difference, padded to three.
type Taps = [f32; 3];
const FIRST: Taps = [-1.0, 1.0, 0.0];
const SECOND: Taps = [1.0, -2.0, 1.0];

/// Adds the weighted gradients of the regularisers to `gradients` and returns their values.
pub fn regularise(layout: &Layout, parameters: &[f32], gradients: &mut [f32], weights: &PlaneWeights) -> PlaneLosses {
    let features = layout.config.features as usize;
    let mut losses = PlaneLosses::default();
    for plane in &layout.planes {
        let range = plane.offset..plane.offset + plane.rows * plane.cols * features;
        let (values, gradient) = (&parameters[range.clone()], &mut gradients[range]);
        let row_length = plane.cols * features;
        if plane.is_time() {
            losses.time += across_rows(row_length, values, gradient, SECOND, weights.time);
            losses.time_l1 += distance_from_one(row_length, values, gradient, weights.time_l1);
            continue;
        }
        losses.space += match weights.form {
            SpatialSmoothness::SecondDifference => across_rows(row_length, values, gradient, SECOND, weights.space),
            SpatialSmoothness::TotalVariation => {
                across_rows(row_length, values, gradient, FIRST, weights.space)
                    + along_rows(row_length, features, values, gradient, weights.space)
            }
        };
    }
    losses
}

/// The mean square of a difference between rows, and its gradient. Each row of the gradient is gathered from the (at
/// most three) differences that it takes part in.
fn across_rows(row_length: usize, values: &[f32], gradient: &mut [f32], taps: Taps, weight: f32) -> f64 {
    let reach = if taps[2] == 0.0 { 1 } else { 2 };
    let rows = values.len() / row_length;
    if rows <= reach {
        return 0.0;
    }
    let count = (rows - reach) * row_length;
    let scale = weight * 2.0 / count as f32;
    let sums: Vec<f64> = gradient
        .par_chunks_mut(row_length)
        .with_min_len(8)
        .enumerate()
        .map(|(row, gradient)| {
            // Rows row - 2 to row + 2; those outside are not used, because their differences get a factor of 0.
            let near: [&[f32]; 5] = std::array::from_fn(|offset| {
                &values[(row + offset).saturating_sub(2).min(rows - 1) * row_length..][..row_length]
            });
            let by: [f32; 3] = std::array::from_fn(|tap| {
                let exists = row >= tap && row - tap + reach < rows;
                if exists { scale * taps[tap] } else { 0.0 }
            });
            let sum = gather_row(near, gradient, taps, by);
            if row + reach < rows { sum } else { 0.0 }
        })
        .collect();
    sums.into_iter().sum::<f64>() / count as f64
}

/// Adds `by[tap]` times the difference that starts `tap` rows before the middle one of `near`, for each tap; returns the
/// sum of squares of the one that starts at the middle. Rows are multiples of four floats.
fn gather_row(near: [&[f32]; 5], gradient: &mut [f32], taps: Taps, by: [f32; 3]) -> f64 {
    let mut squares = [0.0_f32; 4];
    let [a, b, c, d, e] = near.map(|row| row.chunks_exact(4));
    for (((((gradient, a), b), c), d), e) in gradient.chunks_exact_mut(4).zip(a).zip(b).zip(c).zip(d).zip(e) {
        for lane in 0..4 {
            let before = taps[0] * a[lane] + taps[1] * b[lane] + taps[2] * c[lane];
            let middle = taps[0] * b[lane] + taps[1] * c[lane] + taps[2] * d[lane];
            let after = taps[0] * c[lane] + taps[1] * d[lane] + taps[2] * e[lane];
            gradient[lane] += by[2] * before + by[1] * middle + by[0] * after;
            squares[lane] += after * after;
        }
    }
    squares.into_iter().map(f64::from).sum()
}

/// The mean squared first difference between neighbouring cells of a row, and its gradient.
fn along_rows(row_length: usize, features: usize, values: &[f32], gradient: &mut [f32], weight: f32) -> f64 {
    let length = row_length - features;
    let count = values.len() / row_length * length;
    let scale = weight * 2.0 / count as f32;
    let sums: Vec<f64> = gradient
        .par_chunks_mut(row_length)
        .with_min_len(8)
        .zip(values.par_chunks(row_length))
        .map(|(gradient, values)| {
            let mut sum = 0.0;
            for i in 0..length {
                let difference = values[i + features] - values[i];
                gradient[i] -= scale * difference;
                gradient[i + features] += scale * difference;
                sum += f64::from(difference * difference);
            }
            sum
        })
        .collect();
    sums.into_iter().sum::<f64>() / count as f64
}

/// The mean of |1 - p|, and its gradient, 0 where p is 1. Rows are multiples of four floats.
fn distance_from_one(row_length: usize, values: &[f32], gradient: &mut [f32], weight: f32) -> f64 {
    let scale = weight / values.len() as f32;
    let sums: Vec<f64> = gradient
        .par_chunks_mut(row_length)
        .with_min_len(8)
        .zip(values.par_chunks(row_length))
        .map(|(gradient, values)| {
            let mut sums = [0.0_f32; 4];
            for (gradient, values) in gradient.chunks_exact_mut(4).zip(values.chunks_exact(4)) {
                for lane in 0..4 {
                    let off = values[lane] - 1.0;
                    gradient[lane] += if off == 0.0 { 0.0 } else { scale.copysign(off) };
                    sums[lane] += off.abs();
                }
            }
            sums.into_iter().map(f64::from).sum::<f64>()
        })
        .collect();
    sums.into_iter().sum::<f64>() / values.len() as f64
}
