//! By how much the cameras change when a part of what they saw is left out.
//!
//! The inverse of the normal matrix takes every corner's error for its own. What all corners of a view share does not fall with
//! their number: a board that is bent, frames that were not taken at quite the same instant, a lens that the model does not
//! follow where the board was. The jackknife asks the data: each group of views is left out in turn, and the scatter of the
//! solutions is the variance (Tukey 1958; for clusters Bell and McCaffrey 2002, "CR3"). One Newton step stands for each
//! solution. It errs on the large side where there are few groups.

use nalgebra::{Cholesky, DVector};
use rayon::prelude::*;

use super::{
    Bundle, Loss,
    normal::{Layout, Matrix6, Normal, linearise},
    reduced::{reduced_gradient, schur},
    uncertainty::own_inverses,
};

/// With fewer groups their scatter says nothing.
const FEWEST: usize = 4;

/// As many groups as tell something and cost little.
pub const MOST_GROUPS: usize = 40;

/// Groups of placements that were seen one after the other, so many at most.
#[must_use]
pub fn successive(placements: usize, most: usize) -> Vec<usize> {
    let size = placements.div_ceil(most).max(1);
    (0..placements).map(|placement| placement / size).collect()
}

/// The variance of each parameter of the cameras. `None` where it cannot be told: too few groups, or one without which the
/// cameras are not determined.
pub(super) fn variances(bundle: &Bundle, normal: &Normal, loss: Loss, groups: &[usize]) -> Option<DVector<f64>> {
    let whole = reduced(bundle, normal)?.0;
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); groups.iter().max().map_or(0, |most| most + 1)];
    for (index, observation) in bundle.observations.iter().enumerate().filter(|(_, o)| o.used) {
        members[groups[observation.placement]].push(index);
    }
    members.retain(|members| !members.is_empty());
    let count = members.len();
    if count < FEWEST || whole.nrows() == 0 {
        return None;
    }
    let changes: Option<Vec<DVector<f64>>> = members
        .par_iter()
        .map(|members| {
            let part = Bundle {
                cameras: bundle.cameras.clone(),
                placements: bundle.placements.clone(),
                sides: bundle.sides.clone(),
                observations: members.iter().map(|index| bundle.observations[*index]).collect(),
                priors: Vec::new(),
            };
            let (matrix, gradient) = reduced(&part, &linearise(&part, loss, &Layout::new(&part)))?;
            Some(Cholesky::new(&whole - matrix)?.solve(&gradient))
        })
        .collect();
    let mut sum = DVector::zeros(whole.nrows());
    for change in changes? {
        sum += change.component_mul(&change);
    }
    sum *= (count - 1) as f64 / count as f64;
    sum.iter().all(|value| value.is_finite()).then_some(sum)
}

/// The cameras' matrix and gradient after elimination of the placements.
fn reduced(bundle: &Bundle, normal: &Normal) -> Option<(nalgebra::DMatrix<f64>, DVector<f64>)> {
    let layout = Layout::new(bundle);
    let inverses: Vec<Vec<Matrix6>> =
        own_inverses(normal).into_iter().map(|part| part.into_iter().map(|(inverse, _)| inverse).collect()).collect();
    let matrix = schur(normal, &layout, &inverses);
    let gradient = reduced_gradient(normal, &layout, &inverses);
    matrix.iter().chain(gradient.iter()).all(|value| value.is_finite()).then_some((matrix, gradient))
}
