//! How a body turns.

use glam::{DQuat, DVec3};

/// A turn about one axis at one rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// When the body's axes are those of the world, seconds.
    pub upright_s: f64,
    /// Axis times rate, radians per second.
    pub rate: DVec3,
}

impl Turn {
    /// From the body's axes to the world's.
    pub fn at(&self, t_s: f64) -> DQuat {
        DQuat::from_scaled_axis(self.rate * (t_s - self.upright_s))
    }
}

/// `count` directions, evenly spread: a Fibonacci spiral on the sphere.
pub fn directions(count: usize) -> Vec<DVec3> {
    let direction = |index: usize| {
        let at = index as f64 + 0.5;
        let up = 1.0 - 2.0 * at / count as f64;
        let (sin, cos) = (std::f64::consts::PI * (1.0 + 5_f64.sqrt()) * at).sin_cos();
        let flat = (1.0 - up * up).max(0.0).sqrt();
        DVec3::new(cos * flat, sin * flat, up)
    };
    (0..count).map(direction).collect()
}

/// No turn first, and then each direction with each rate.
pub fn rates(directions_count: usize, rates: &[f64]) -> Vec<DVec3> {
    let all = directions(directions_count).into_iter().flat_map(|along| rates.iter().map(move |&rate| along * rate));
    std::iter::once(DVec3::ZERO).chain(all).collect()
}

/// Improves `start` by steps along the axes of `first` radians per second, halved `halvings` times, as long as `score` grows.
pub fn climb(start: (f64, DVec3), first: f64, halvings: u32, score: impl Fn(&[DVec3]) -> Vec<f64>) -> (f64, DVec3) {
    let (mut best, mut at) = start;
    for halving in 0..=halvings {
        let step = first * 0.5_f64.powi(halving as i32);
        for _ in 0..6 {
            let tries: Vec<DVec3> =
                DVec3::AXES.into_iter().chain(DVec3::AXES.map(|axis| -axis)).map(|axis| at + step * axis).collect();
            let scores = score(&tries);
            let top = std::iter::zip(scores, tries).max_by(|a, b| a.0.total_cmp(&b.0));
            match top {
                Some((score, rate)) if score > best => (best, at) = (score, rate),
                _ => break,
            }
        }
    }
    (best, at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_of_length_one_and_leave_no_gap() {
        let all = directions(60);
        assert!(all.iter().all(|along| (along.length() - 1.0).abs() < 1e-12));
        for probe in directions(997) {
            let nearest = all.iter().map(|along| along.angle_between(probe)).fold(9.0, f64::min);
            assert!(nearest < 0.35, "{nearest} rad from the next");
        }
    }

    #[test]
    fn climbing_ends_near_the_top() {
        let top = DVec3::new(3.0, -7.0, 12.0);
        let score = |tries: &[DVec3]| tries.iter().map(|rate| -rate.distance(top)).collect::<Vec<_>>();
        let start = DVec3::new(5.0, -5.0, 10.0);
        let (_, found) = climb((-start.distance(top), start), 3.0, 5, score);
        assert!(found.distance(top) < 0.2, "{found}");
    }

    #[test]
    fn a_turn_is_none_when_upright_and_half_a_turn_half_a_turn_later() {
        let turn = Turn { upright_s: 0.3, rate: DVec3::Z * std::f64::consts::PI };
        assert!((turn.at(0.3) * DVec3::X).abs_diff_eq(DVec3::X, 1e-12));
        assert!((turn.at(0.8) * DVec3::X).abs_diff_eq(DVec3::Y, 1e-12));
    }
}
