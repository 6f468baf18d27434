//! Errors that neighbours share: the covariance of what many clusters of observations say, not of what the model promises.
//!
//! The inverse of the normal matrix takes every observation's error for its own. Those of features are not: what a lens
//! model leaves over, the slant of a surface, or a wrong match of a repeated pattern moves neighbours alike, so that a
//! thousand points tell less than a thousand. Sums of gradients over clusters of neighbours show by how much they vary, and
//! that takes the place of the promise between two inverses ("sandwich"; Liang and Zeger, Biometrika 73, 1986).

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::{
    Bundle, Loss,
    normal::{Layout, prior_rows},
    residual::row,
};

/// A cluster number for each of `points`: `count` boxes (a power of two) of equally many points, halved across the widest
/// side each time.
#[must_use]
pub fn boxes(points: &[DVec3], count: usize) -> Vec<usize> {
    let mut clusters = vec![0; points.len()];
    let mut parts = vec![(0..points.len()).collect::<Vec<usize>>()];
    while parts.len() < count {
        parts = parts.into_iter().flat_map(|part| halves(points, part)).collect();
    }
    for (number, part) in parts.iter().enumerate() {
        for &point in part {
            clusters[point] = number;
        }
    }
    clusters
}

fn halves(points: &[DVec3], mut part: Vec<usize>) -> [Vec<usize>; 2] {
    let bounds = part.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &point| {
        [low.min(points[point]), high.max(points[point])]
    });
    let axis = (bounds[1] - bounds[0]).max_position();
    let middle = part.len() / 2;
    if middle > 0 {
        part.select_nth_unstable_by(middle, |&a, &b| points[a][axis].total_cmp(&points[b][axis]));
    }
    let upper = part.split_off(middle);
    [part, upper]
}

/// The variance of the gradient by the cameras' parameters, from how much it varies between clusters of placements.
/// `clusters` has an entry for each placement.
pub(super) fn gradient_variance(bundle: &Bundle, layout: &Layout, loss: Loss, clusters: &[usize]) -> DMatrix<f64> {
    let count = clusters.iter().max().map_or(0, |most| most + 1);
    let mut sums = vec![DVector::zeros(layout.shared); count];
    let mut filled = vec![false; count];
    for observation in bundle.observations.iter().filter(|o| o.used) {
        let camera = &bundle.cameras[observation.camera];
        let side = observation.side.map(|side| &bundle.sides[side]);
        let Some(row) = row(camera, &bundle.placements[observation.placement], side, observation) else { continue };
        let weight = loss.weight(row.residual.length_squared());
        let cluster = clusters[observation.placement];
        filled[cluster] = true;
        for axis in 0..2 {
            let slopes = &row.by_camera[axis][..camera.free.len()];
            let of_side = observation.side.map(|side| layout.of_sides()[side].clone());
            let by_side = of_side.into_iter().flatten().zip(&row.by_side[axis]);
            for (column, slope) in layout.columns[observation.camera].clone().zip(slopes).chain(by_side) {
                sums[cluster][column] += slope * weight * row.residual[axis];
            }
        }
    }
    let mut variance = DMatrix::zeros(layout.shared, layout.shared);
    let number = filled.iter().filter(|filled| **filled).count() as f64;
    // The sums of all clusters add up to nothing, so that one of them is not free.
    let correction = if number > 1.0 { number / (number - 1.0) } else { 1.0 };
    for sum in &sums {
        variance.syger(correction, sum, sum, 1.0);
    }
    variance.fill_upper_triangle_with_lower_triangle();
    for (columns, slopes) in prior_rows(bundle, layout) {
        for (&i, a) in columns.iter().zip(&slopes) {
            for (&j, b) in columns.iter().zip(&slopes) {
                variance[(i, j)] += a * b;
            }
        }
    }
    variance
}
