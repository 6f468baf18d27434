//! Normals of points on a hull.

use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen};

/// So many neighbours tell how the surface lies.
const NEIGHBOURS: usize = 10;

/// The normal of each of `points`, given about a centre from which normals point away.
pub fn normals(points: &[DVec3]) -> Vec<DVec3> {
    let normal = |&point: &DVec3| {
        let mut near: Vec<(f64, DVec3)> = points.iter().map(|&other| (other.distance_squared(point), other)).collect();
        let count = NEIGHBOURS.min(near.len());
        if count < near.len() {
            near.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0));
        }
        let near = &near[..count];
        let middle = near.iter().map(|(_, other)| *other).sum::<DVec3>() / count as f64;
        let mut spread = Matrix3::zeros();
        for (_, other) in near {
            let away = other - middle;
            let away = nalgebra::Vector3::new(away.x, away.y, away.z);
            spread += away * away.transpose();
        }
        let eigen = SymmetricEigen::new(spread);
        let flattest = eigen.eigenvectors.column(eigen.eigenvalues.imin());
        let normal = DVec3::new(flattest[0], flattest[1], flattest[2]);
        if normal.dot(point) < 0.0 { -normal } else { normal }
    };
    points.iter().map(normal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::turn::directions;

    #[test]
    fn normals_of_a_sphere_point_away_from_its_centre() {
        let points: Vec<DVec3> = directions(400).into_iter().map(|along| 0.2 * along).collect();
        for (normal, point) in std::iter::zip(normals(&points), &points) {
            assert!(normal.angle_between(*point) < 0.1);
        }
        assert!(normals(&[]).is_empty());
        assert!(normals(&[DVec3::X]).iter().all(|normal| normal.is_finite()));
    }
}
