//! The regularisers of the planes on the host.

use rayon::prelude::*;

use crate::field::{Layout, PlaneLosses, PlaneWeights, SpatialSmoothness, layout::Plane};

/// A difference along one axis of a plane: its taps, and how far apart they are.
struct Stencil {
    taps: &'static [f32],
    /// Floats between two taps.
    step: usize,
    /// Whether the taps lie in different rows.
    across_rows: bool,
}

const FIRST: &[f32] = &[-1.0, 1.0];
const SECOND: &[f32] = &[1.0, -2.0, 1.0];

/// Adds the weighted gradients of the regularisers to `gradients` and returns their values.
pub fn regularise(layout: &Layout, parameters: &[f32], gradients: &mut [f32], weights: &PlaneWeights) -> PlaneLosses {
    let features = layout.config.features as usize;
    let mut losses = PlaneLosses::default();
    for plane in &layout.planes {
        let range = plane.offset..plane.offset + plane.rows * plane.cols * features;
        let (values, gradient) = (&parameters[range.clone()], &mut gradients[range]);
        let row_length = plane.cols * features;
        let along_rows = |taps| Stencil { taps, step: row_length, across_rows: true };
        if plane.is_time() {
            losses.time += smooth(plane, features, values, gradient, &along_rows(SECOND), weights.time);
            losses.time_l1 += distance_from_one(row_length, values, gradient, weights.time_l1);
            continue;
        }
        losses.space += match weights.form {
            SpatialSmoothness::SecondDifference => {
                smooth(plane, features, values, gradient, &along_rows(SECOND), weights.space)
            }
            SpatialSmoothness::TotalVariation => {
                let across = Stencil { taps: FIRST, step: features, across_rows: false };
                smooth(plane, features, values, gradient, &along_rows(FIRST), weights.space)
                    + smooth(plane, features, values, gradient, &across, weights.space)
            }
        };
    }
    losses
}

/// The mean square of a stencil, and its gradient. Each row of the gradient is gathered from the stencils that touch it.
fn smooth(plane: &Plane, features: usize, values: &[f32], gradient: &mut [f32], stencil: &Stencil, weight: f32) -> f64 {
    let taps = stencil.taps;
    let row_length = plane.cols * features;
    let reach = taps.len() - 1;
    let (rows, cols) = if stencil.across_rows {
        (plane.rows.saturating_sub(reach), plane.cols)
    } else {
        (plane.rows, plane.cols.saturating_sub(reach))
    };
    let count = rows * cols * features;
    if count == 0 {
        return 0.0;
    }
    let scale = weight * 2.0 / count as f32;
    let sums: Vec<f64> = gradient
        .par_chunks_mut(row_length)
        .with_min_len(8)
        .enumerate()
        .map(|(row, gradient)| {
            // Value of the stencil that starts `start` floats into the plane, at float `i` of it.
            let length = cols * features;
            let at = |start: usize| -> [&[f32]; 3] {
                std::array::from_fn(|tap| &values[start + tap.min(reach) * stencil.step..][..length])
            };
            let third = taps.get(2).copied().unwrap_or(0.0);
            let sample =
                |from: &[&[f32]; 3], i: usize| taps[0] * from[0][i] + taps[1] * from[1][i] + third * from[2][i];
            if stencil.across_rows {
                for (tap, by) in taps.iter().enumerate() {
                    if let Some(first) = row.checked_sub(tap).filter(|first| *first < rows) {
                        let from = at(first * row_length);
                        let by = by * scale;
                        for (i, d) in gradient.iter_mut().enumerate() {
                            *d += by * sample(&from, i);
                        }
                    }
                }
            } else {
                let from = at(row * row_length);
                for (tap, by) in taps.iter().enumerate() {
                    let by = by * scale;
                    for (i, d) in gradient[tap * features..][..length].iter_mut().enumerate() {
                        *d += by * sample(&from, i);
                    }
                }
            }
            if row >= rows {
                return 0.0;
            }
            let from = at(row * row_length);
            lanes_sum(length, |i| sample(&from, i) * sample(&from, i))
        })
        .collect();
    sums.into_iter().sum::<f64>() / count as f64
}

/// The mean of |1 - p|, and its gradient, 0 where p is 1.
fn distance_from_one(row_length: usize, values: &[f32], gradient: &mut [f32], weight: f32) -> f64 {
    let scale = weight / values.len() as f32;
    let sums: Vec<f64> = gradient
        .par_chunks_mut(row_length)
        .with_min_len(8)
        .zip(values.par_chunks(row_length))
        .map(|(gradient, values)| {
            for (d, value) in gradient.iter_mut().zip(values) {
                let off = value - 1.0;
                *d += if off == 0.0 { 0.0 } else { scale.copysign(off) };
            }
            lanes_sum(values.len(), |i| (values[i] - 1.0).abs())
        })
        .collect();
    sums.into_iter().sum::<f64>() / values.len() as f64
}

/// The sum of `value(0..length)` in eight running sums, so that it can use vector instructions.
fn lanes_sum(length: usize, value: impl Fn(usize) -> f32) -> f64 {
    let mut lanes = [0.0_f32; 8];
    let whole = length / 8 * 8;
    for start in (0..whole).step_by(8) {
        for (lane, sum) in lanes.iter_mut().enumerate() {
            *sum += value(start + lane);
        }
    }
    let rest: f32 = (whole..length).map(value).sum();
    lanes.into_iter().map(f64::from).sum::<f64>() + f64::from(rest)
}
