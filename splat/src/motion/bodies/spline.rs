//! Uniform cubic B-splines in time, and their fit to samples.

/// The four control points that decide at a place, counted from the first, and their weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basis {
    /// The first of the four.
    pub first: usize,
    /// Their weights, which add up to 1.
    pub weights: [f64; 4],
}

/// The basis at `s` stretches from the beginning of a spline of `knots` control points (at least 4); beyond the ends, that at the end.
#[must_use]
pub fn basis(s: f64, knots: usize) -> Basis {
    let last = knots.saturating_sub(4);
    let s = s.clamp(0.0, (last + 1) as f64);
    let first = (s.floor() as usize).min(last);
    let u = s - first as f64;
    let v = 1.0 - u;
    let weights = [
        v * v * v / 6.0,
        (u * u * (3.0 * u - 6.0) + 4.0) / 6.0,
        (u * (u * (3.0 - 3.0 * u) + 3.0) + 1.0) / 6.0,
        u * u * u / 6.0,
    ];
    Basis { first, weights }
}

/// The control points of the spline that comes nearest to `samples` (place on the spline in stretches, value), where `stiffness` times
/// the squared third differences of its control points are added to the squared errors: what no sample tells goes on as it is.
#[must_use]
pub fn fit<const N: usize>(samples: &[(f64, [f64; N])], knots: usize, stiffness: f64) -> Vec<[f64; N]> {
    /// The diagonal and three beside it, and what keeps the matrix regular where too few samples are for even a parabola.
    const BAND: usize = 4;
    const TINY: f64 = 1e-12;
    let mut matrix = vec![[0.0; BAND]; knots];
    let mut right = vec![[0.0; N]; knots];
    let mut add = |first: usize, weights: &[f64; 4], value: Option<&[f64; N]>, weight: f64| {
        for (i, a) in weights.iter().enumerate() {
            for (j, b) in weights.iter().enumerate().skip(i) {
                matrix[first + i][j - i] += weight * a * b;
            }
            for (sum, value) in right[first + i].iter_mut().zip(value.into_iter().flatten()) {
                *sum += weight * a * value;
            }
        }
    };
    for (s, value) in samples {
        let Basis { first, weights } = basis(*s, knots);
        add(first, &weights, Some(value), 1.0);
    }
    for first in 0..=knots.saturating_sub(4) {
        add(first, &[-1.0, 3.0, -3.0, 1.0], None, stiffness);
    }
    // Towards the mean, by next to nothing.
    let count = samples.len().max(1) as f64;
    let mean: [f64; N] = std::array::from_fn(|k| samples.iter().map(|(_, value)| value[k]).sum::<f64>() / count);
    for (row, right) in matrix.iter_mut().zip(&mut right) {
        row[0] += TINY;
        right.iter_mut().zip(mean).for_each(|(sum, mean)| *sum += TINY * mean);
    }
    solve(matrix, right)
}

/// Solves a symmetric positive definite system whose matrix has a diagonal and three beside it (row i: columns i to i + 3).
fn solve<const N: usize>(mut matrix: Vec<[f64; 4]>, mut right: Vec<[f64; N]>) -> Vec<[f64; N]> {
    let size = matrix.len();
    for i in 0..size {
        let row = matrix[i];
        for below in 1..4.min(size - i) {
            let share = row[below] / row[0];
            for column in below..4 {
                matrix[i + below][column - below] -= share * row[column];
            }
            let own = right[i];
            right[i + below].iter_mut().zip(own).for_each(|(value, own)| *value -= share * own);
        }
    }
    for i in (0..size).rev() {
        right[i] = std::array::from_fn(|k| {
            let beyond: f64 = (1..4.min(size - i)).map(|at| matrix[i][at] * right[i + at][k]).sum();
            (right[i][k] - beyond) / matrix[i][0]
        });
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(control: &[[f64; 1]], s: f64) -> f64 {
        let Basis { first, weights } = basis(s, control.len());
        (0..4).map(|k| weights[k] * control[first + k][0]).sum()
    }

    #[test]
    fn a_cubic_is_followed_exactly_and_goes_on_as_a_parabola() {
        let cubic = |s: f64| 0.3 - s + 0.2 * s * s - 0.01 * s * s * s;
        let samples: Vec<(f64, [f64; 1])> =
            (0..60).map(|k| (0.2 * f64::from(k), [cubic(0.2 * f64::from(k))])).collect();
        let control = fit(&samples, 15, 1e-9);
        for (s, [wanted]) in &samples {
            assert!((value(&control, *s) - wanted).abs() < 1e-6, "{s}");
        }
        // Samples of the middle alone: the rest has no third derivative.
        let parabola = |s: f64| 1.0 + s - 0.1 * s * s;
        let middle: Vec<(f64, [f64; 1])> =
            (0..9).map(|k| (4.0 + 0.4 * f64::from(k), [parabola(4.0 + 0.4 * f64::from(k))])).collect();
        let control = fit(&middle, 15, 1e-3);
        for s in [0.0, 2.0, 6.0, 9.0, 12.0] {
            assert!((value(&control, s) - parabola(s)).abs() < 1e-3, "{s}: {}", value(&control, s));
        }
    }

    #[test]
    fn weights_add_up_to_one_and_the_ends_hold() {
        for s in [-3.0, 0.0, 0.5, 3.999, 4.0, 99.0, f64::MAX] {
            let Basis { first, weights } = basis(s, 7);
            assert!(first <= 3 && (weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{s}");
        }
        assert_eq!(basis(0.3, 4).first, 0);
    }

    #[test]
    fn one_sample_is_a_constant() {
        let control = fit(&[(1.0, [5.0, -2.0])], 8, 0.01);
        for [a, b] in control {
            assert!((a - 5.0).abs() < 1e-3 && (b + 2.0).abs() < 1e-3, "{a} {b}");
        }
    }
}
