//! One damped step: the placements are eliminated, the cameras solved, the placements put back in.
//!
//! A placement is tied to cameras and to no other placement, so that eliminating it costs a 6x6 inverse. What remains is a
//! system in the cameras' parameters. It is formed and factored where it is small (exact: Cholesky); where there are
//! thousands of parameters it is never formed, and solved by conjugate gradients (approximate, to a relative 1e-8).

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use super::normal::{Block, Layout, Matrix6, Normal, Vector6};

/// How the cameras' system is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// By size: [`Method::Cholesky`] up to 1500 parameters.
    #[default]
    Auto,
    /// Formed and factored; exact.
    Cholesky,
    /// Conjugate gradients with one block of the preconditioner for each camera and side; approximate, needs no matrix.
    ConjugateGradients,
}

/// Up to so many parameters the cameras' system is factored: 18 MB, half a second.
const FACTORED: usize = 1500;
/// Relative residual at which conjugate gradients stop.
const TOLERANCE: f64 = 1e-8;

impl Method {
    pub(super) fn for_size(self, shared: usize) -> Self {
        match self {
            Self::Auto if shared <= FACTORED => Self::Cholesky,
            Self::Auto => Self::ConjugateGradients,
            chosen => chosen,
        }
    }
}

/// A step: of the cameras' parameters, and of each placement's.
pub(super) struct Damped {
    pub shared: DVector<f64>,
    pub placements: Vec<Vector6>,
    /// By how much the linear model says that the cost falls.
    pub predicted: f64,
}

/// The step for damping `lambda`; `None` where a matrix is not positive definite.
pub(super) fn step(normal: &Normal, layout: &Layout, lambda: f64, method: Method) -> Option<Damped> {
    let inverses = damped_inverses(normal, lambda)?;
    let damping = normal.shared.diagonal().map(|value| lambda * value.max(1e-9));
    let rhs = reduced_gradient(normal, layout, &inverses);
    let shared = if layout.shared == 0 {
        DVector::zeros(0)
    } else if method.for_size(layout.shared) == Method::Cholesky {
        let mut matrix = schur(normal, layout, &inverses);
        for (index, value) in damping.iter().enumerate() {
            matrix[(index, index)] += value;
        }
        Cholesky::new(matrix)?.solve(&rhs)
    } else {
        conjugate_gradients(normal, layout, &inverses, &damping, &rhs)?
    };
    let blocks: Vec<(&Block, &Matrix6)> = paired(normal, &inverses).collect();
    let placements: Vec<Vector6> = blocks
        .par_iter()
        .map(|(block, inverse)| {
            let mut right = -block.gradient;
            for tie in block.ties.iter() {
                right -= tie.transposed_product(&shared.as_slice()[layout.columns[tie.number].clone()]);
            }
            *inverse * right
        })
        .collect();
    // With (J^T J + D) h = -g the model's decrease is h . (D h - g) / 2.
    let mut predicted = 0.0;
    for index in 0..layout.shared {
        predicted += 0.5 * shared[index] * (damping[index] * shared[index] - normal.gradient[index]);
    }
    for ((block, _), own) in blocks.iter().zip(&placements) {
        for index in 0..6 {
            let damping = lambda * damping_of(&block.own, index);
            predicted += 0.5 * own[index] * (damping * own[index] - block.gradient[index]);
        }
    }
    let finite = shared.iter().all(|v| v.is_finite()) && predicted.is_finite();
    finite.then_some(Damped { shared, placements, predicted })
}

fn damping_of(own: &Matrix6, index: usize) -> f64 {
    own[(index, index)].max(1e-9 * own.diagonal().max())
}

fn damped_inverses(normal: &Normal, lambda: f64) -> Option<Vec<Vec<Matrix6>>> {
    let invert = |block: &Block| {
        let mut own = block.own;
        for index in 0..6 {
            own[(index, index)] += lambda * damping_of(&block.own, index);
        }
        own.cholesky().map(|factor| factor.inverse())
    };
    normal.blocks.par_iter().map(|part| part.iter().map(invert).collect()).collect()
}

fn paired<'a>(normal: &'a Normal, inverses: &'a [Vec<Matrix6>]) -> impl Iterator<Item = (&'a Block, &'a Matrix6)> {
    normal.blocks.iter().zip(inverses).flat_map(|(blocks, inverses)| blocks.iter().zip(inverses))
}

/// The right side of the cameras' system: minus the gradient, after elimination.
pub(super) fn reduced_gradient(normal: &Normal, layout: &Layout, inverses: &[Vec<Matrix6>]) -> DVector<f64> {
    let mut rhs = -&normal.gradient;
    for (block, inverse) in paired(normal, inverses) {
        let solved = inverse * block.gradient;
        for tie in block.ties.iter() {
            tie.add_product(&solved, 1.0, &mut rhs.as_mut_slice()[layout.columns[tie.number].clone()]);
        }
    }
    rhs
}

/// The cameras' matrix after elimination of the placements, whose inverses are given.
pub(super) fn schur(normal: &Normal, layout: &Layout, inverses: &[Vec<Matrix6>]) -> DMatrix<f64> {
    let parts: Vec<DMatrix<f64>> = normal
        .blocks
        .par_iter()
        .zip(inverses)
        .map(|(blocks, inverses)| {
            let mut matrix = DMatrix::zeros(layout.shared, layout.shared);
            for (block, inverse) in blocks.iter().zip(inverses) {
                let solved = block.ties.times(inverse);
                for (index, left) in solved.iter().enumerate() {
                    let a = layout.columns[left.number].start;
                    for right in block.ties.iter().take(index + 1) {
                        let b = layout.columns[right.number].start;
                        if a >= b {
                            left.subtract_product(&right, &mut matrix, [a, b]);
                        } else {
                            right.subtract_product(&left, &mut matrix, [b, a]);
                        }
                    }
                }
            }
            matrix
        })
        .collect();
    let mut matrix = normal.shared.clone();
    for part in parts {
        matrix += part;
    }
    // Symmetric to the last digit: what is above the diagonal was not summed up.
    matrix.fill_upper_triangle_with_lower_triangle();
    matrix
}

fn conjugate_gradients(
    normal: &Normal,
    layout: &Layout,
    inverses: &[Vec<Matrix6>],
    damping: &DVector<f64>,
    rhs: &DVector<f64>,
) -> Option<DVector<f64>> {
    let product = |x: &DVector<f64>| {
        let mut y = x.component_mul(damping);
        for columns in &layout.columns {
            let own = normal.shared.view((columns.start, columns.start), (columns.len(), columns.len()));
            let mut to = y.rows_mut(columns.start, columns.len());
            to += own * x.rows(columns.start, columns.len());
        }
        // Cameras are tied to each other through placements alone, to the sides of targets directly.
        let cameras = layout.of_cameras().len();
        for columns in layout.of_sides().iter().filter(|columns| !columns.is_empty()) {
            let across = normal.shared.view((0, columns.start), (cameras, columns.len()));
            let mut to = y.rows_mut(0, cameras);
            to += across * x.rows(columns.start, columns.len());
            let mut to = y.rows_mut(columns.start, columns.len());
            to += across.tr_mul(&x.rows(0, cameras));
        }
        for (block, inverse) in paired(normal, inverses) {
            let mut own = Vector6::zeros();
            for tie in block.ties.iter() {
                own += tie.transposed_product(&x.as_slice()[layout.columns[tie.number].clone()]);
            }
            let own = inverse * own;
            for tie in block.ties.iter() {
                tie.add_product(&own, -1.0, &mut y.as_mut_slice()[layout.columns[tie.number].clone()]);
            }
        }
        y
    };
    let preconditioner: Vec<_> = layout
        .columns
        .iter()
        .map(|columns| {
            let mut own =
                normal.shared.view((columns.start, columns.start), (columns.len(), columns.len())).into_owned();
            for (index, column) in columns.clone().enumerate() {
                own[(index, index)] += damping[column];
            }
            Cholesky::new(own)
        })
        .collect::<Option<_>>()?;
    let condition = |r: &DVector<f64>| {
        let mut z = DVector::zeros(r.len());
        for (columns, factor) in layout.columns.iter().zip(&preconditioner) {
            z.rows_mut(columns.start, columns.len())
                .copy_from(&factor.solve(&r.rows(columns.start, columns.len()).into_owned()));
        }
        z
    };
    let mut x = DVector::zeros(rhs.len());
    let mut r = rhs.clone();
    let mut z = condition(&r);
    let mut p = z.clone();
    let mut rz = r.dot(&z);
    let enough = TOLERANCE * rhs.norm();
    for _ in 0..(10 * rhs.len()).min(2000) {
        if r.norm() <= enough {
            break;
        }
        let along = product(&p);
        let curvature = p.dot(&along);
        if curvature <= 0.0 || !curvature.is_finite() {
            return None;
        }
        let far = rz / curvature;
        x.axpy(far, &p, 1.0);
        r.axpy(-far, &along, 1.0);
        z = condition(&r);
        let next = r.dot(&z);
        p = &z + &p * (next / rz);
        rz = next;
    }
    Some(x)
}
