//! The normal equations at a state, in blocks: cameras, placements, and what ties the one to the other.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use rayon::prelude::*;

use super::{Bundle, Loss, Parameter, Prior, Side, residual::row, ties::Ties};

pub(super) type Matrix6 = SMatrix<f64, 6, 6>;
pub(super) type Vector6 = SVector<f64, 6>;

/// What an observation costs that its camera cannot see at all: a residual of so many standard deviations. It has no
/// derivative; a step that loses sight of something is dear, one that regains it is rewarded.
const LOST: f64 = 1e4;
/// Into how many parts the placements are divided at most. Sums are formed part by part in this order, whatever the number
/// of threads.
const PARTS: usize = 16;

/// Which placement each observation belongs to, and where a camera's parameters are among all of them.
pub(super) struct Layout {
    /// Observations that take part, by placement.
    by_placement: Vec<Vec<usize>>,
    /// The columns of each camera, and after all cameras those of each side of a target.
    pub columns: Vec<Range<usize>>,
    /// Number of cameras.
    pub cameras: usize,
    /// Number of columns.
    pub shared: usize,
    /// Number of observations that take part.
    pub observations: usize,
    /// Number of parameters of the placements that are seen.
    pub private: usize,
}

impl Layout {
    pub fn new(bundle: &Bundle) -> Self {
        let mut by_placement = vec![Vec::new(); bundle.placements.len()];
        let mut observations = 0;
        for (index, observation) in bundle.observations.iter().enumerate().filter(|(_, o)| o.used) {
            by_placement[observation.placement].push(index);
            observations += 1;
        }
        let mut shared = 0;
        let cameras = bundle.cameras.len();
        let mut columns = Vec::with_capacity(cameras + bundle.sides.len());
        let of_cameras = bundle.cameras.iter().map(|camera| camera.free.len());
        for count in of_cameras.chain(bundle.sides.iter().map(Side::parameters)) {
            columns.push(shared..shared + count);
            shared += count;
        }
        let seen = bundle.placements.iter().zip(&by_placement).filter(|(_, seen)| !seen.is_empty());
        let private = seen.map(|(placement, _)| placement.parameters()).sum();
        Self { by_placement, columns, cameras, shared, observations, private }
    }

    /// The columns of all cameras.
    pub fn of_cameras(&self) -> Range<usize> {
        0..self.columns[..self.cameras].last().map_or(0, |columns| columns.end)
    }

    /// The columns of each side.
    pub fn of_sides(&self) -> &[Range<usize>] {
        &self.columns[self.cameras..]
    }

    fn part(&self) -> usize {
        self.by_placement.len().div_ceil(PARTS).max(64)
    }
}

/// One placement's share.
pub(super) struct Block {
    /// Second derivatives of the placement's own parameters; the identity where it has none.
    pub own: Matrix6,
    /// Derivatives of the cost by the placement's own parameters.
    pub gradient: Vector6,
    /// The cameras that see it and the sides of it that are seen.
    pub ties: Ties,
}

/// The normal equations.
pub(super) struct Normal {
    /// Half the sum of squares (or of what the loss makes of them).
    pub cost: f64,
    /// Of all observations that take part.
    pub rms_px: f64,
    /// Second derivatives of the parameters that all placements share.
    pub shared: DMatrix<f64>,
    /// Their gradient.
    pub gradient: DVector<f64>,
    /// The placements, in parts.
    pub blocks: Vec<Vec<Block>>,
}

/// The cost of a state alone, and the root mean square residual, pixels.
pub(super) fn cost(bundle: &Bundle, loss: Loss, layout: &Layout) -> (f64, f64) {
    let parts: Vec<(f64, f64)> = layout
        .by_placement
        .par_chunks(layout.part())
        .map(|placements| {
            let (mut cost, mut squares) = (0.0, 0.0);
            for observation in placements.iter().flatten().map(|index| &bundle.observations[*index]) {
                match bundle.residual_px(observation) {
                    Some(residual) => {
                        squares += residual.length_squared();
                        cost += loss.value(residual.length_squared() / observation.sigma_px.powi(2));
                    }
                    None => cost += loss.value(LOST * LOST),
                }
            }
            (cost, squares)
        })
        .collect();
    let (mut sum, mut squares) = (priors(bundle).map(|prior| prior.residual.powi(2)).sum::<f64>(), 0.0);
    for (part, square) in parts {
        sum += part;
        squares += square;
    }
    (0.5 * sum, (squares / layout.observations.max(1) as f64).sqrt())
}

/// A prior's residual in standard deviations, and its derivatives by cameras' free parameters.
struct PriorRow {
    residual: f64,
    by: Vec<(usize, Vec<f64>)>,
}

impl PriorRow {
    /// The columns that it depends on, and its slopes by them.
    fn row(&self, layout: &Layout) -> (Vec<usize>, Vec<f64>) {
        let entries =
            self.by.iter().flat_map(|(camera, slopes)| layout.columns[*camera].clone().zip(slopes.iter().copied()));
        entries.unzip()
    }
}

/// The columns that each prior depends on, and its slopes by them, in standard deviations.
pub(super) fn prior_rows(bundle: &Bundle, layout: &Layout) -> Vec<(Vec<usize>, Vec<f64>)> {
    priors(bundle).map(|prior| prior.row(layout)).collect()
}

fn priors(bundle: &Bundle) -> impl Iterator<Item = PriorRow> {
    bundle.priors.iter().map(|prior| match prior {
        Prior::Value { camera, parameter, value, sigma } => {
            let state = &bundle.cameras[*camera];
            let slope = |free: &Parameter| match (free, parameter) {
                _ if free == parameter => 1.0 / sigma,
                (Parameter::Focal, Parameter::Fx) | (Parameter::Fx, Parameter::Focal) => 1.0 / sigma,
                (Parameter::Focal, Parameter::Fy) => state.intrinsics.fy / state.intrinsics.fx / sigma,
                _ => 0.0,
            };
            let by = vec![(*camera, state.free.iter().map(slope).collect())];
            PriorRow { residual: (parameter.value(state) - value) / sigma, by }
        }
        Prior::Distance { cameras, metres, sigma } => {
            let [a, b] = cameras.map(|camera| &bundle.cameras[camera]);
            let apart = a.pose.centre() - b.pose.centre();
            // A shift v of a camera moves its centre by -R^T v; a turn about the camera does not.
            let along = apart.normalize_or_zero() / *sigma;
            let by = [(cameras[0], a, -1.0), (cameras[1], b, 1.0)].map(|(index, camera, sign)| {
                let turned = camera.pose.rotation * along * sign;
                let slope = |free: &Parameter| match free {
                    Parameter::Translation(axis) => turned[usize::from(*axis)],
                    _ => 0.0,
                };
                (index, camera.free.iter().map(slope).collect())
            });
            PriorRow { residual: (apart.length() - metres) / sigma, by: by.into() }
        }
    })
}

/// One part's sums.
struct Part {
    blocks: Vec<Block>,
    /// Of each camera and each side.
    shared: Vec<DMatrix<f64>>,
    gradients: Vec<DVector<f64>>,
    /// Of each side: all cameras' parameters by the side's.
    across: Vec<DMatrix<f64>>,
    cost: f64,
    squares: f64,
}

/// The normal equations at the bundle's state.
pub(super) fn linearise(bundle: &Bundle, loss: Loss, layout: &Layout) -> Normal {
    let parts: Vec<Part> = layout
        .by_placement
        .par_chunks(layout.part())
        .enumerate()
        .map(|(part, placements)| linearise_part(bundle, loss, layout, part * layout.part(), placements))
        .collect();
    let mut shared = DMatrix::zeros(layout.shared, layout.shared);
    let mut gradient = DVector::zeros(layout.shared);
    let (mut cost, mut squares) = (0.0, 0.0);
    let mut blocks = Vec::with_capacity(parts.len());
    for part in parts {
        for ((columns, own), slope) in layout.columns.iter().zip(&part.shared).zip(&part.gradients) {
            let mut to = shared.view_mut((columns.start, columns.start), (columns.len(), columns.len()));
            to += own;
            let mut to = gradient.rows_mut(columns.start, columns.len());
            to += slope;
        }
        for (columns, across) in layout.of_sides().iter().zip(&part.across) {
            let mut to = shared.view_mut((0, columns.start), (layout.of_cameras().len(), columns.len()));
            to += across;
            let mut to = shared.view_mut((columns.start, 0), (columns.len(), layout.of_cameras().len()));
            to += across.transpose();
        }
        cost += part.cost;
        squares += part.squares;
        blocks.push(part.blocks);
    }
    for prior in priors(bundle) {
        cost += prior.residual.powi(2);
        let (columns, slopes) = prior.row(layout);
        for (&i, a) in columns.iter().zip(&slopes) {
            gradient[i] += a * prior.residual;
            for (&j, b) in columns.iter().zip(&slopes) {
                shared[(i, j)] += a * b;
            }
        }
    }
    let rms_px = (squares / layout.observations.max(1) as f64).sqrt();
    Normal { cost: 0.5 * cost, rms_px, shared, gradient, blocks }
}

/// An observation as a camera or a side sees it: a weight, and of either coordinate the residual and slopes.
#[derive(Clone, Copy)]
struct Weighed<'a> {
    weight: f64,
    residual: [f64; 2],
    /// By the parameters of the camera or the side.
    slopes: [&'a [f64]; 2],
}

impl Weighed<'_> {
    /// Adds it to the sums of the camera or side with this number; of second derivatives what is not above the diagonal.
    fn add(&self, part: &mut Part, number: usize) {
        let Self { weight, residual, slopes: [first, second] } = *self;
        let gradient = part.gradients[number].as_mut_slice();
        let columns = part.shared[number].as_mut_slice();
        let count = gradient.len();
        for j in 0..count {
            let (a, b) = (first[j] * weight, second[j] * weight);
            gradient[j] += a * residual[0] + b * residual[1];
            let column = &mut columns[j * count..][..count];
            for ((to, first), second) in column[j..].iter_mut().zip(&first[j..]).zip(&second[j..]) {
                *to += a * first + b * second;
            }
        }
    }
}

fn linearise_part(bundle: &Bundle, loss: Loss, layout: &Layout, first: usize, placements: &[Vec<usize>]) -> Part {
    let counts = || layout.columns.iter().map(Range::len);
    let cameras = layout.of_cameras().len();
    let mut part = Part {
        blocks: Vec::with_capacity(placements.len()),
        shared: counts().map(|count| DMatrix::zeros(count, count)).collect(),
        gradients: counts().map(DVector::zeros).collect(),
        across: layout.of_sides().iter().map(|columns| DMatrix::zeros(cameras, columns.len())).collect(),
        cost: 0.0,
        squares: 0.0,
    };
    for (index, observations) in placements.iter().enumerate() {
        let placement = &bundle.placements[first + index];
        let ties = Ties::new(placement.parameters());
        let mut block = Block { own: Matrix6::zeros(), gradient: Vector6::zeros(), ties };
        for observation in observations.iter().map(|index| &bundle.observations[*index]) {
            let (camera, side) = (observation.camera, observation.side);
            let of_side = side.map(|side| &bundle.sides[side]);
            let Some(row) = row(&bundle.cameras[camera], placement, of_side, observation) else {
                part.cost += loss.value(LOST * LOST);
                continue;
            };
            let squared = row.residual.length_squared();
            part.cost += loss.value(squared);
            part.squares += squared * observation.sigma_px.powi(2);
            let weight = loss.weight(squared);
            let own = row.by_placement.map(Vector6::from);
            for (axis, own) in own.iter().enumerate() {
                block.own += own * own.transpose() * weight;
                block.gradient += own * (weight * row.residual[axis]);
            }
            let own = own.map(|own| own * weight);
            let free = layout.columns[camera].len();
            let slopes = row.by_camera.each_ref().map(|by| &by[..free]);
            let weighed = Weighed { weight, residual: row.residual.to_array(), slopes };
            weighed.add(&mut part, camera);
            block.ties.add(camera, slopes, own.each_ref());
            let Some(side) = side.filter(|_| of_side.is_some_and(|side| side.free)) else { continue };
            let by_side = row.by_side.each_ref().map(<[f64; 6]>::as_slice);
            Weighed { slopes: by_side, ..weighed }.add(&mut part, layout.cameras + side);
            block.ties.add(layout.cameras + side, by_side, own.each_ref());
            for (slopes, by_side) in slopes.into_iter().zip(by_side) {
                for (i, a) in layout.columns[camera].clone().zip(slopes) {
                    for (j, b) in by_side.iter().enumerate() {
                        part.across[side][(i, j)] += a * weight * b;
                    }
                }
            }
        }
        for unused in placement.parameters()..6 {
            block.own[(unused, unused)] = 1.0;
        }
        if observations.is_empty() {
            block.own = Matrix6::identity();
        }
        part.blocks.push(block);
    }
    part.shared.iter_mut().for_each(DMatrix::fill_upper_triangle_with_lower_triangle);
    part
}
