//! Planes: the map between a plane and its image, and the plane's pose.

use erfgs_scene::Pose;
use glam::{DMat3, DVec2, DVec3};
use nalgebra::{DMatrix, SMatrix};

/// Where a map takes a point; `None` where that is nowhere in the plane.
#[must_use]
pub fn apply(map: &DMat3, at: DVec2) -> Option<DVec2> {
    let place = *map * at.extend(1.0);
    let at = place.truncate() / place.z;
    at.is_finite().then_some(at)
}

/// The map that takes plane points `from` to image points `to`, up to scale, by the direct linear transform with both sides
/// moved and scaled to unit spread (Hartley 1997). `None` for fewer than four points or points on a line.
#[must_use]
pub fn homography(from: &[DVec2], to: &[DVec2]) -> Option<DMat3> {
    if from.len() < 4 || from.len() != to.len() {
        return None;
    }
    let (a, b) = (normalisation(from)?, normalisation(to)?);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in from.iter().zip(to) {
        let (p, q) = (a.transform_point2(*p), b.transform_point2(*q));
        for row in [
            [-p.x, -p.y, -1.0, 0.0, 0.0, 0.0, q.x * p.x, q.x * p.y, q.x],
            [0.0, 0.0, 0.0, -p.x, -p.y, -1.0, q.y * p.x, q.y * p.y, q.y],
        ] {
            let row = SMatrix::<f64, 9, 1>::from(row);
            normal += row * row.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|i, j| eigen.eigenvalues[*i].total_cmp(&eigen.eigenvalues[*j]));
    // A second vanishing eigenvalue: more than one map fits.
    if eigen.eigenvalues[order[1]] <= 1e-12 * eigen.eigenvalues[order[8]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let rows = DMat3::from_cols_array(&[h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]]).transpose();
    let map = b.inverse() * rows * a;
    (map.is_finite() && map.determinant() != 0.0).then_some(map)
}

/// The map that moves points to mean 0 and mean distance sqrt 2.
fn normalisation(points: &[DVec2]) -> Option<DMat3> {
    let count = points.len() as f64;
    let mean = points.iter().sum::<DVec2>() / count;
    let spread = points.iter().map(|point| (*point - mean).length()).sum::<f64>() / count;
    (spread > 0.0 && spread.is_finite()).then(|| {
        let scale = std::f64::consts::SQRT_2 / spread;
        DMat3::from_cols(
            DVec3::new(scale, 0.0, 0.0),
            DVec3::new(0.0, scale, 0.0),
            DVec3::new(-scale * mean.x, -scale * mean.y, 1.0),
        )
    })
}

/// The pose (plane to camera) of a plane whose points `on_plane` are seen in the directions `rays` (camera space, of any
/// length, before the camera). `None` where four points do not determine it.
#[must_use]
pub fn plane_pose(on_plane: &[DVec2], rays: &[DVec3]) -> Option<Pose> {
    let (from, to): (Vec<DVec2>, Vec<DVec2>) = on_plane
        .iter()
        .zip(rays)
        .filter(|(_, ray)| ray.z > 0.05 * ray.length())
        .map(|(point, ray)| (*point, ray.truncate() / ray.z))
        .unzip();
    let map = homography(&from, &to)?;
    let scale = 2.0 / (map.x_axis.length() + map.y_axis.length());
    // The plane lies before the camera.
    let sign = if (map * from[0].extend(1.0)).z < 0.0 { -scale } else { scale };
    let (x, y, translation) = (map.x_axis * sign, map.y_axis * sign, map.z_axis * sign);
    Some(Pose::from_matrix(nearest_rotation(DMat3::from_cols(x, y, x.cross(y)))?, translation))
}

/// The rotation nearest to a matrix, in the sum of squares.
#[must_use]
pub fn nearest_rotation(matrix: DMat3) -> Option<DMat3> {
    let svd = DMatrix::from_column_slice(3, 3, &matrix.to_cols_array()).svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?);
    let to_glam = |m: DMatrix<f64>| DMat3::from_cols_slice(m.as_slice());
    let (mut u, v) = (to_glam(u), to_glam(v));
    if (u * v).determinant() < 0.0 {
        u.z_axis = -u.z_axis;
    }
    let rotation = u * v;
    rotation.is_finite().then_some(rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Vec<DVec2> {
        (0..20).map(|i| DVec2::new(f64::from(i % 5) * 0.03, f64::from(i / 5) * 0.03)).collect()
    }

    #[test]
    fn the_pose_of_a_plane_comes_back() {
        let pose = Pose {
            rotation: glam::DQuat::from_scaled_axis(DVec3::new(0.4, -0.5, 1.9)),
            translation: DVec3::new(0.1, -0.2, 0.7),
        };
        let rays: Vec<DVec3> = grid().iter().map(|p| pose.transform(p.extend(0.0)) * 3.0).collect();
        let found = plane_pose(&grid(), &rays).unwrap();
        assert!((found.translation - pose.translation).length() < 1e-9);
        assert!(found.rotation.angle_between(pose.rotation) < 1e-7);
    }

    #[test]
    fn points_on_a_line_give_nothing() {
        let line: Vec<DVec2> = (0..6).map(|i| DVec2::new(f64::from(i), 2.0 * f64::from(i))).collect();
        assert_eq!(homography(&line, &line), None);
        assert_eq!(homography(&grid()[..3], &grid()[..3]), None);
    }

    #[test]
    fn a_reflection_becomes_the_nearest_rotation() {
        let mirrored = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -0.1));
        assert!((nearest_rotation(mirrored).unwrap().determinant() - 1.0).abs() < 1e-12);
    }
}
