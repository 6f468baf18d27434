//! The motion that takes one set of points to another (Umeyama 1991, "Least-squares estimation of transformation
//! parameters between two point patterns").

use erfgs_scene::Pose;
use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, SVD};

/// A change of frame with a change of scale: `x' = scale * R x + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Factor of lengths.
    pub scale: f64,
    /// Rotation and translation.
    pub pose: Pose,
}

impl Similarity {
    /// Leaves everything where it is.
    pub const IDENTITY: Self = Self { scale: 1.0, pose: Pose::IDENTITY };

    /// A point in the other frame.
    #[must_use]
    pub fn transform(&self, point: DVec3) -> DVec3 {
        self.pose.rotation * point * self.scale + self.pose.translation
    }

    /// Where a camera of the one frame stands in the other: the world-to-camera pose, its camera space scaled too.
    #[must_use]
    pub fn of_camera(&self, camera: &Pose) -> Pose {
        let rotation = (camera.rotation * self.pose.rotation.conjugate()).normalize();
        Pose { rotation, translation: -(rotation * self.transform(camera.centre())) }
    }

    /// Distance of the centres and angle of the orientations after alignment.
    #[must_use]
    pub fn difference(&self, from: &Pose, to: &Pose) -> (f64, f64) {
        let moved = self.of_camera(from);
        (moved.centre().distance(to.centre()), angle(moved.rotation, to.rotation))
    }

    /// The least-squares similarity of several pairs of poses (Umeyama's, with the orientations taking part, so that
    /// cameras on a line are enough). `None` for fewer than two, or where all centres of one side coincide.
    #[must_use]
    pub fn of_poses(pairs: &[(Pose, Pose)]) -> Option<Self> {
        if pairs.len() < 2 {
            return None;
        }
        let n = pairs.len() as f64;
        let mean = |centre: &dyn Fn(&(Pose, Pose)) -> DVec3| pairs.iter().map(centre).sum::<DVec3>() / n;
        let (from, to) = (mean(&|p| p.0.centre()), mean(&|p| p.1.centre()));
        let spread =
            |centre: &dyn Fn(&(Pose, Pose)) -> DVec3| pairs.iter().map(|p| centre(p).length_squared()).sum::<f64>();
        let from_spread = spread(&|p| p.0.centre() - from);
        let to_spread = spread(&|p| p.1.centre() - to);
        if !(from_spread > 0.0 && to_spread > 0.0) {
            return None;
        }
        // How a turn shows in the centres, and (much less) in the orientations.
        let orientation = 0.01 * (from_spread * to_spread).sqrt() / n;
        let mut covariance = DMat3::ZERO;
        for (a, b) in pairs {
            let (x, y) = (a.centre() - from, b.centre() - to);
            covariance += DMat3::from_cols(y * x.x, y * x.y, y * x.z);
            covariance += DMat3::from_quat(b.rotation.conjugate() * a.rotation) * orientation;
        }
        let svd = Matrix3::from_column_slice(&covariance.to_cols_array()).svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let mut sign = Matrix3::identity();
        sign[(2, 2)] = (u * v_t).determinant().signum();
        let rotation = u * sign * v_t;
        let rotation = DQuat::from_mat3(&DMat3::from_cols_slice(rotation.as_slice())).normalize();
        let along: f64 = pairs.iter().map(|(a, b)| (rotation * (a.centre() - from)).dot(b.centre() - to)).sum();
        let scale = along / from_spread;
        let sound = scale > 0.0 && scale.is_finite() && rotation.is_finite();
        sound.then(|| Self { scale, pose: Pose { rotation, translation: to - rotation * from * scale } })
    }
}

/// Angle between two rotations, radians.
#[must_use]
pub fn angle(a: DQuat, b: DQuat) -> f64 {
    2.0 * (a.conjugate() * b).normalize().w.abs().min(1.0).acos()
}

/// The rigid motion that takes the first of each pair of points to the second with the least sum of squares, each square
/// multiplied with the weight. `None` with fewer than three pairs of positive weight, or with all of them on one line.
#[must_use]
pub fn rigid(pairs: &[(DVec3, DVec3, f64)]) -> Option<Pose> {
    umeyama(pairs, false).map(|similarity| similarity.pose)
}

/// As [`rigid`], with a scale.
#[must_use]
pub fn similarity(pairs: &[(DVec3, DVec3, f64)]) -> Option<Similarity> {
    umeyama(pairs, true)
}

fn umeyama(pairs: &[(DVec3, DVec3, f64)], scaled: bool) -> Option<Similarity> {
    let positive = || pairs.iter().filter(|(_, _, weight)| *weight > 0.0);
    let sum: f64 = positive().map(|pair| pair.2).sum();
    if positive().count() < 3 || !sum.is_finite() {
        return None;
    }
    let mean = |of: fn(&(DVec3, DVec3, f64)) -> DVec3| positive().map(|pair| of(pair) * pair.2).sum::<DVec3>() / sum;
    let (from, to) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let mut covariance = DMat3::ZERO;
    let mut spread = 0.0;
    for &(a, b, weight) in positive() {
        let (a, b) = (a - from, b - to);
        covariance += DMat3::from_cols(b * a.x, b * a.y, b * a.z) * (weight / sum);
        spread += a.length_squared() * weight / sum;
    }
    let svd = SVD::new(Matrix3::from_column_slice(&covariance.to_cols_array()), true, true);
    let (u, vt, values) = (svd.u?, svd.v_t?, svd.singular_values);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    // Points on one line leave the turn about it open.
    if values[order[1]] <= 1e-10 * values[order[0]] {
        return None;
    }
    let mut flip = Matrix3::identity();
    if u.determinant() * vt.determinant() < 0.0 {
        flip[(order[2], order[2])] = -1.0;
    }
    let rotation = DMat3::from_cols_slice((u * flip * vt).as_slice());
    let trace: f64 = (0..3).map(|i| values[i] * flip[(i, i)]).sum();
    let scale = if scaled { trace / spread } else { 1.0 };
    let pose = Pose::from_matrix(rotation, to - rotation * from * scale);
    (pose.is_finite() && scale.is_finite() && scale > 0.0).then_some(Similarity { scale, pose })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> Similarity {
        let rotation = DQuat::from_scaled_axis(DVec3::new(0.3, -2.0, 1.1));
        Similarity { scale: 2.5, pose: Pose { rotation, translation: DVec3::new(1.0, 2.0, -3.0) } }
    }

    #[test]
    fn a_motion_is_found_from_its_points_even_in_a_plane() {
        for height in [0.7, 0.0] {
            let points = [DVec3::ZERO, DVec3::X, DVec3::Y * 2.0, DVec3::new(0.5, 0.2, height)];
            let pairs = points.map(|point| (point, truth().transform(point), 1.0));
            let found = similarity(&pairs).unwrap();
            assert!((found.scale - 2.5).abs() < 1e-12);
            for point in points {
                assert!((found.transform(point) - truth().transform(point)).length() < 1e-12, "{height}");
            }
            let pose = rigid(&points.map(|point| (point, truth().pose.transform(point), 0.5))).unwrap();
            assert!((pose.translation - truth().pose.translation).length() < 1e-12);
        }
    }

    #[test]
    fn a_line_or_two_points_do_not_tell_a_motion() {
        let line = [0.0, 1.0, 2.0, 5.0].map(|x| (DVec3::X * x, DVec3::Y * x, 1.0));
        assert_eq!(rigid(&line), None);
        assert_eq!(rigid(&line[..2]), None);
        assert_eq!(rigid(&[(DVec3::X, DVec3::Y, f64::NAN); 4]), None);
    }

    #[test]
    fn a_camera_keeps_what_it_sees_up_to_scale() {
        let camera = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Y);
        let point = DVec3::new(0.2, -0.4, 0.1);
        let moved = truth().of_camera(&camera).transform(truth().transform(point));
        assert!((moved - camera.transform(point) * 2.5).length() < 1e-12);
    }
}
