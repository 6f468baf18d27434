//! How well the cameras are determined: covariance, rank, and the names of what is left open.

use glam::{DMat3, DVec3};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{
    Bundle, Parameter,
    normal::{Layout, Matrix6, Normal},
    reduced::schur,
};
use crate::linear::symmetric_eigen;

/// An eigenvalue of the scaled matrix below this counts as zero: what is left is rounding.
const RANK: f64 = 1e-11;
/// Parameters that make up less than this share of an open direction are not named.
const NAMED: f64 = 0.02;

/// What one camera's observations leave uncertain.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraUncertainty {
    /// Standard deviation of each free parameter, in the order of [`BundleCamera::free`](super::BundleCamera::free);
    /// infinite where it is not determined.
    pub sigma: Vec<f64>,
    /// Covariance of the camera's centre in the world, square metres; zero where the pose is fixed.
    pub centre: DMat3,
    /// Standard deviations of turns about the camera's axes, radians.
    pub rotation: DVec3,
}

/// What the observations leave uncertain of a side of a target.
#[derive(Clone, Debug, PartialEq)]
pub struct SideUncertainty {
    /// Standard deviations of turns about the axes of the placement's frame, radians; infinite where they are not determined,
    /// zero where the side is fixed.
    pub rotation: DVec3,
    /// Those of where its middle is, along the same axes, metres.
    pub middle: DVec3,
}

/// A combination of parameters that no observation tells anything about.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenDirection {
    /// The parameters that take part, the greatest first: camera, parameter, share of the squared length. Sides of targets are
    /// counted after the cameras.
    pub parameters: Vec<(usize, Parameter, f64)>,
}

/// How well the free parameters are determined.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// Sum of squared residuals in standard deviations, over the degrees of freedom: 1 where the given standard deviations
    /// are right. The covariance is multiplied with it.
    pub variance_factor: f64,
    /// Number of measured coordinates and priors minus that of determined parameters.
    pub degrees_of_freedom: usize,
    /// Greatest over smallest eigenvalue of the cameras' matrix, each parameter scaled to what it would be known to if all
    /// others were; infinite where the rank is not full.
    pub condition: f64,
    /// Rank of the same matrix.
    pub rank: usize,
    /// Per camera.
    pub cameras: Vec<CameraUncertainty>,
    /// Per side of a target.
    pub sides: Vec<SideUncertainty>,
    /// What is not determined; empty in a sound problem.
    pub open: Vec<OpenDirection>,
    /// Number of placements with a direction of their own that is not determined, such as the depth of a point in one view.
    pub open_placements: usize,
    /// Covariance of all free parameters of all cameras and then all sides, in order.
    pub covariance: DMatrix<f64>,
}

/// What is said of the errors of observations.
pub(super) enum Errors<'a> {
    /// Each is its own.
    Own,
    /// They are shared within clusters, between which the gradient varies by so much: it stands between the two inverses.
    Shared(&'a DMatrix<f64>),
    /// As [`Errors::Own`], but no parameter is known better than to this variance.
    AtLeast(&'a DVector<f64>),
}

/// The inverse of each placement's own matrix, and the number of its directions that are open.
pub(super) fn own_inverses(normal: &Normal) -> Vec<Vec<(Matrix6, usize)>> {
    normal.blocks.par_iter().map(|part| part.iter().map(|block| pseudo_inverse(&block.own)).collect()).collect()
}

pub(super) fn uncertainty(bundle: &Bundle, layout: &Layout, normal: &Normal, errors: &Errors<'_>) -> Uncertainty {
    let inverses = own_inverses(normal);
    let open_of_placements: usize = inverses.iter().flatten().map(|(_, open)| open).sum();
    let open_placements = inverses.iter().flatten().filter(|(_, open)| *open > 0).count();
    let inverses: Vec<Vec<Matrix6>> =
        inverses.into_iter().map(|part| part.into_iter().map(|(inverse, _)| inverse).collect()).collect();
    let matrix = schur(normal, layout, &inverses);
    let scale = normal.shared.diagonal().map(|value| if value > 0.0 { 1.0 / value.sqrt() } else { 1.0 });
    let scaled = DMatrix::from_fn(layout.shared, layout.shared, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let eigen = symmetric_eigen(scaled);
    let zero = |value: f64| value <= RANK;
    let rank = eigen.values.iter().filter(|value| !zero(**value)).count();
    let measured = 2 * layout.observations + bundle.priors.len();
    let degrees_of_freedom = measured.saturating_sub(rank + layout.private - open_of_placements);
    let variance_factor = if degrees_of_freedom > 0 { 2.0 * normal.cost / degrees_of_freedom as f64 } else { 1.0 };
    let names: Vec<(usize, Parameter)> =
        free_parameters(bundle).enumerate().flat_map(|(number, free)| free.iter().map(move |p| (number, *p))).collect();
    let mut covariance = DMatrix::zeros(layout.shared, layout.shared);
    let mut open = Vec::new();
    // How much of each parameter lies in directions that are open.
    let mut lost = DVector::zeros(layout.shared);
    for (value, vector) in eigen.values.iter().zip(eigen.vectors.column_iter()) {
        if zero(*value) {
            lost += vector.component_mul(&vector);
            let mut parameters: Vec<_> = names
                .iter()
                .zip(vector.iter())
                .map(|(&(camera, parameter), part)| (camera, parameter, part * part))
                .filter(|(_, _, share)| *share >= NAMED)
                .collect();
            parameters.sort_by(|a, b| b.2.total_cmp(&a.2));
            open.push(OpenDirection { parameters });
        } else {
            let column = vector.component_mul(&scale);
            covariance.syger(1.0 / value, &column, &column, 1.0);
        }
    }
    covariance.fill_upper_triangle_with_lower_triangle();
    let covariance = match errors {
        Errors::Own => covariance * variance_factor,
        Errors::Shared(between) => &covariance * *between * &covariance,
        Errors::AtLeast(variances) => widened(covariance * variance_factor, variances),
    };
    let (least, most) = (eigen.values.min(), eigen.values.max());
    let cameras = (0..bundle.cameras.len()).map(|c| camera(bundle, layout, &covariance, &open, c)).collect();
    let sides = (0..bundle.sides.len()).map(|s| side(layout, &covariance, &lost, s)).collect();
    Uncertainty {
        variance_factor,
        degrees_of_freedom,
        condition: if layout.shared == 0 {
            1.0
        } else if zero(least) {
            f64::INFINITY
        } else {
            most / least
        },
        rank,
        cameras,
        sides,
        open,
        open_placements,
        covariance,
    }
}

/// The free parameters of each camera, and then of each side of a target.
fn free_parameters(bundle: &Bundle) -> impl Iterator<Item = &[Parameter]> {
    let of_cameras = bundle.cameras.iter().map(|camera| camera.free.as_slice());
    of_cameras.chain(bundle.sides.iter().map(|side| side.free_parameters()))
}

/// A covariance whose variances are at least these; correlations stay.
fn widened(mut covariance: DMatrix<f64>, variances: &DVector<f64>) -> DMatrix<f64> {
    let factor = |index: usize| {
        let own = covariance[(index, index)];
        if own > 0.0 { (variances[index] / own).max(1.0).sqrt() } else { 1.0 }
    };
    let factors: Vec<f64> = (0..covariance.nrows()).map(factor).collect();
    for (row, a) in factors.iter().enumerate() {
        for (column, b) in factors.iter().enumerate() {
            covariance[(row, column)] *= a * b;
        }
    }
    covariance
}

/// The inverse where there is one, and the number of directions where there is none.
fn pseudo_inverse(own: &Matrix6) -> (Matrix6, usize) {
    let scale = own.diagonal().map(|value| if value > 0.0 { 1.0 / value.sqrt() } else { 1.0 });
    let scaled = Matrix6::from_fn(|i, j| own[(i, j)] * scale[i] * scale[j]);
    let eigen = scaled.symmetric_eigen();
    let (mut inverse, mut open) = (Matrix6::zeros(), 0);
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value <= RANK {
            open += 1;
        } else {
            let column = vector.component_mul(&scale);
            inverse += column * column.transpose() / *value;
        }
    }
    (inverse, open)
}

fn camera(
    bundle: &Bundle,
    layout: &Layout,
    covariance: &DMatrix<f64>,
    open: &[OpenDirection],
    index: usize,
) -> CameraUncertainty {
    let (camera, columns) = (&bundle.cameras[index], &layout.columns[index]);
    let is_open = |parameter: Parameter| {
        open.iter().flat_map(|direction| &direction.parameters).any(|&(c, p, _)| c == index && p == parameter)
    };
    let sigma = columns.clone().zip(&camera.free).map(|(column, parameter)| {
        if is_open(*parameter) { f64::INFINITY } else { covariance[(column, column)].max(0.0).sqrt() }
    });
    let sigma: Vec<f64> = sigma.collect();
    let column = |parameter: Parameter| {
        camera.free.iter().position(|free| *free == parameter).map(|position| columns.start + position)
    };
    let mut shift = DMat3::ZERO;
    let mut rotation = DVec3::ZERO;
    for i in 0..3_u8 {
        if let Some(a) = column(Parameter::Rotation(i)) {
            let open = is_open(Parameter::Rotation(i));
            rotation[usize::from(i)] = if open { f64::INFINITY } else { covariance[(a, a)].max(0.0).sqrt() };
        }
        for j in 0..3_u8 {
            if let (Some(a), Some(b)) = (column(Parameter::Translation(i)), column(Parameter::Translation(j))) {
                shift.col_mut(usize::from(j))[usize::from(i)] = covariance[(a, b)];
            }
        }
    }
    // A shift v along the camera's axes moves its centre by -R^T v.
    let to_world = DMat3::from_quat(camera.pose.rotation.conjugate());
    CameraUncertainty { sigma, centre: to_world * shift * to_world.transpose(), rotation }
}

fn side(layout: &Layout, covariance: &DMatrix<f64>, lost: &DVector<f64>, index: usize) -> SideUncertainty {
    // Cameras that an open side leaves open take part by much more than the side, which is small and seen by all.
    const LOST: f64 = 1e-6;
    let columns = &layout.of_sides()[index];
    let sigma = |parameter: usize| match columns.clone().nth(parameter) {
        Some(column) if lost[column] > LOST => f64::INFINITY,
        Some(column) => covariance[(column, column)].max(0.0).sqrt(),
        None => 0.0,
    };
    SideUncertainty {
        rotation: DVec3::new(sigma(0), sigma(1), sigma(2)),
        middle: DVec3::new(sigma(3), sigma(4), sigma(5)),
    }
}
