//! What ties a placement to the cameras that see it: mixed second derivatives.
//!
//! A camera has a handful of parameters, a placement at most six, and there may be a million such pairs: what a general product
//! of matrices does before it computes takes longer than computing. So there is one array for all that see a placement, in
//! lanes of four of a camera's parameters (zeros in what is over), a row of lanes for each of the placement's.

use nalgebra::DMatrix;

use super::normal::{Matrix6, Vector6};

/// So many of a camera's parameters are computed at once.
const LANES: usize = 4;

/// The mixed second derivatives of one placement and each camera that sees it, and each side of it that is seen.
pub(super) struct Ties {
    /// Number of the placement's parameters.
    own: usize,
    /// Who sees it: the number, that of its parameters, and where its lanes begin.
    seen: Vec<(usize, usize, usize)>,
    lanes: Vec<[f64; LANES]>,
}

/// The part of one camera, or of one side.
#[derive(Clone, Copy)]
pub(super) struct Tie<'a> {
    /// The camera or the side, numbered as [`Layout::columns`](super::normal::Layout::columns).
    pub number: usize,
    parameters: usize,
    own: usize,
    lanes: &'a [[f64; LANES]],
}

impl Ties {
    /// Of a placement with `own` parameters that nobody has seen yet.
    pub fn new(own: usize) -> Self {
        Self { own, seen: Vec::new(), lanes: Vec::new() }
    }

    /// Adds the product of a camera's slopes and the placement's, for both coordinates of an observation.
    pub fn add(&mut self, number: usize, slopes: [&[f64]; 2], by_own: [&Vector6; 2]) {
        let count = slopes[0].len().div_ceil(LANES);
        let begin = match self.seen.iter().find(|(seen, ..)| *seen == number) {
            Some((.., begin)) => *begin,
            None => {
                let begin = self.lanes.len();
                self.seen.push((number, slopes[0].len(), begin));
                self.lanes.resize(begin + count * self.own, [0.0; LANES]);
                begin
            }
        };
        let lanes = &mut self.lanes[begin..begin + count * self.own];
        let of_lanes = slopes[0].chunks(LANES).zip(slopes[1].chunks(LANES));
        for (lane, (first, second)) in of_lanes.enumerate() {
            let (first, second) = (filled(first), filled(second));
            for own in 0..self.own {
                let (a, b) = (by_own[0][own], by_own[1][own]);
                let to = &mut lanes[own * count + lane];
                for i in 0..LANES {
                    to[i] += first[i] * a + second[i] * b;
                }
            }
        }
    }

    /// Of each that sees the placement.
    pub fn iter(&self) -> impl Iterator<Item = Tie<'_>> {
        self.seen.iter().map(|&(number, parameters, begin)| Tie {
            number,
            parameters,
            own: self.own,
            lanes: &self.lanes[begin..begin + parameters.div_ceil(LANES) * self.own],
        })
    }

    /// Times a symmetric matrix of the placement's parameters.
    pub fn times(&self, matrix: &Matrix6) -> Self {
        let mut lanes = vec![[0.0; LANES]; self.lanes.len()];
        for &(_, parameters, begin) in &self.seen {
            let count = parameters.div_ceil(LANES);
            for own in 0..self.own {
                let column = &matrix.as_slice()[6 * own..][..6];
                for lane in 0..count {
                    let mut sum = [0.0; LANES];
                    for (other, factor) in column[..self.own].iter().enumerate() {
                        let from = &self.lanes[begin + other * count + lane];
                        for i in 0..LANES {
                            sum[i] += from[i] * factor;
                        }
                    }
                    lanes[begin + own * count + lane] = sum;
                }
            }
        }
        Self { own: self.own, seen: self.seen.clone(), lanes }
    }
}

impl Tie<'_> {
    fn count(&self) -> usize {
        self.parameters.div_ceil(LANES)
    }

    /// The derivative by one of the camera's parameters and one of the placement's.
    fn at(&self, parameter: usize, own: usize) -> f64 {
        self.lanes[own * self.count() + parameter / LANES][parameter % LANES]
    }

    /// Adds to `to` the product with numbers of the placement's parameters, times `sign`.
    pub fn add_product(&self, by: &Vector6, sign: f64, to: &mut [f64]) {
        for own in 0..self.own {
            let (row, factor) = (&self.lanes[own * self.count()..], by[own] * sign);
            for (to, from) in to.iter_mut().zip(row.as_flattened()) {
                *to += factor * from;
            }
        }
    }

    /// The product of the transpose with numbers of the camera's parameters.
    pub fn transposed_product(&self, by: &[f64]) -> Vector6 {
        let mut sums = Vector6::zeros();
        for own in 0..self.own {
            let row = self.lanes[own * self.count()..].as_flattened();
            sums[own] = row.iter().zip(by).map(|(a, b)| a * b).sum();
        }
        sums
    }

    /// Subtracts `self * other^T` from the block of `matrix` that begins at a row and a column.
    pub fn subtract_product(&self, other: &Tie<'_>, matrix: &mut DMatrix<f64>, [row, column]: [usize; 2]) {
        let (height, count) = (matrix.nrows(), self.count());
        for parameter in 0..other.parameters {
            let mut factors = [0.0; 6];
            for (own, factor) in factors[..self.own].iter_mut().enumerate() {
                *factor = other.at(parameter, own);
            }
            let to = &mut matrix.as_mut_slice()[(column + parameter) * height + row..][..self.parameters];
            for (lane, to) in to.chunks_mut(LANES).enumerate() {
                let mut sum = [0.0; LANES];
                for (own, factor) in factors[..self.own].iter().enumerate() {
                    let from = &self.lanes[own * count + lane];
                    for i in 0..LANES {
                        sum[i] += factor * from[i];
                    }
                }
                for (to, sum) in to.iter_mut().zip(sum) {
                    *to -= sum;
                }
            }
        }
    }
}

fn filled(slopes: &[f64]) -> [f64; LANES] {
    std::array::from_fn(|index| slopes.get(index).copied().unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector, SMatrix};

    use super::*;

    /// What general products of matrices give, for every number of a camera's and a placement's parameters.
    #[test]
    fn products_are_those_of_matrices() {
        let value = |seed: usize| ((seed * 7919 + 13) % 1009) as f64 / 1009.0 - 0.5;
        for (own, parameters, others) in [(0, 3, 1), (3, 1, 9), (3, 8, 4), (5, 19, 6), (6, 6, 6), (6, 13, 2)] {
            let mut ties = Ties::new(own);
            let mut expected = [parameters, others].map(|count| DMatrix::<f64>::zeros(count, 6));
            for observation in 0..5_usize {
                let number = observation % 2;
                let count = [parameters, others][number];
                let slopes =
                    [0, 1].map(|axis| DVector::from_fn(count, |i, _| value(observation * 100 + axis * 40 + i)));
                let by_own = [0, 1].map(|axis| {
                    Vector6::from_fn(|i, _| if i < own { value(observation * 91 + axis * 17 + i) } else { 0.0 })
                });
                ties.add(number, [slopes[0].as_slice(), slopes[1].as_slice()], [&by_own[0], &by_own[1]]);
                for axis in 0..2 {
                    expected[number] += &slopes[axis] * by_own[axis].transpose();
                }
            }
            let half = Matrix6::from_fn(|i, j| if i < own && j < own { value(500 + 6 * i + j) } else { 0.0 });
            let symmetric = half + half.transpose();
            let solved = ties.times(&symmetric);
            let mut matrix = DMatrix::<f64>::zeros(30, 30);
            let mut by_hand = matrix.clone();
            let (first, second) = (solved.iter().next().unwrap(), ties.iter().nth(1).unwrap());
            assert_eq!((first.number, second.number), (0, 1));
            first.subtract_product(&second, &mut matrix, [7, 2]);
            let mut block = by_hand.view_mut((7, 2), (parameters, others));
            block -= &expected[0] * symmetric * expected[1].transpose();
            assert!((&matrix - &by_hand).amax() < 1e-14, "{own} {parameters} {others}");

            let by: SMatrix<f64, 6, 1> = Vector6::from_fn(|i, _| value(700 + i));
            let mut sums = vec![1.0; others];
            second.add_product(&by, -1.0, &mut sums);
            let direct = DVector::from_element(others, 1.0) - &expected[1] * by;
            assert!((DVector::from_vec(sums) - direct).amax() < 1e-14);
            let by = DVector::from_fn(others, |i, _| value(800 + i));
            let direct = expected[1].tr_mul(&by);
            assert!((second.transposed_product(by.as_slice()) - direct).amax() < 1e-14);
        }
    }
}
