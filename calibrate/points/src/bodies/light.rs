//! Light from one side: it stays where it is while things turn below it, so that colours seem to stay, too.

use glam::DVec3;
use nalgebra::{Matrix4, Vector4};

/// A place is at most so many times darker or brighter than usual by it.
const MOST: f64 = 2.0;
/// Fewer places do not tell it.
const FEWEST: usize = 30;

/// How bright a thing is by the direction of its surface: evenly more from one side to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light(Vector4<f64>);

impl Light {
    /// By outward normals, brightnesses, and how much each counts; none if these do not tell it.
    pub fn new(seen: impl IntoIterator<Item = (DVec3, f64, f64)>) -> Option<Self> {
        let (mut normal, mut sums, mut count) = (Matrix4::zeros(), Vector4::zeros(), 0);
        for (along, brightness, weight) in seen {
            let row = row(along);
            normal += weight * row * row.transpose();
            sums += weight * brightness * row;
            count += 1;
        }
        if count < FEWEST {
            return None;
        }
        let light = normal.cholesky()?.solve(&sums);
        light.iter().all(|value| value.is_finite()).then_some(Self(light))
    }

    /// What a colour is multiplied by where the surface faces `along`, so that it is as it is usually.
    pub fn away(&self, along: DVec3) -> f64 {
        (self.0[0] / row(along).dot(&self.0).max(f64::MIN_POSITIVE)).clamp(1.0 / MOST, MOST)
    }
}

fn row(along: DVec3) -> Vector4<f64> {
    Vector4::new(1.0, along.x, along.y, along.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::turn::directions;

    #[test]
    fn what_is_lit_from_one_side_is_even_without_it() {
        let lit = |along: DVec3| 100.0 + 40.0 * along.x - 20.0 * along.y;
        let light = Light::new(directions(50).into_iter().map(|along| (along, lit(along), 1.0))).unwrap();
        for along in directions(70) {
            assert!((lit(along) * light.away(along) - 100.0).abs() < 1e-6);
        }
        assert_eq!(Light::new([]), None);
        assert_eq!(Light::new(directions(3).into_iter().map(|along| (along, 1.0, 1.0))), None);
    }
}
