//! One arrangement of cameras laid over another: a similarity that most of them agree on.

use erfgs_session::Pose;
use glam::{DMat3, DQuat, DVec3};
use nalgebra::Matrix3;

/// `x -> scale * rotation * x + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Scale.
    pub scale: f64,
    /// Rotation.
    pub rotation: DQuat,
    /// Translation.
    pub translation: DVec3,
}

/// How far apart two poses may be to count as the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Between centres, in the unit of the second arrangement.
    pub centre: f64,
    /// Between orientations, radians.
    pub angle: f64,
}

/// An alignment, and which cameras it holds for.
#[derive(Clone, Debug)]
pub struct Alignment {
    /// Takes the first arrangement to the second.
    pub similarity: Similarity,
    /// Per camera: whether it stands alike in both; false where one of them lacks it.
    pub alike: Vec<bool>,
}

impl Similarity {
    /// Leaves everything where it is.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// Where a point goes.
    #[must_use]
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.rotation * point * self.scale + self.translation
    }

    /// The pose of a camera that goes with the points.
    #[must_use]
    pub fn pose(&self, pose: &Pose) -> Pose {
        let rotation = (pose.rotation * self.rotation.conjugate()).normalize();
        Pose { rotation, translation: -(rotation * self.point(pose.centre())) }
    }

    /// Distance of the centres and angle of the orientations after alignment.
    #[must_use]
    pub fn difference(&self, from: &Pose, to: &Pose) -> (f64, f64) {
        let moved = self.pose(from);
        (moved.centre().distance(to.centre()), angle(moved.rotation, to.rotation))
    }

    /// The least-squares similarity of several pairs of poses (Umeyama's, with the orientations taking part, so that
    /// cameras on a line are enough). `None` for fewer than two, or where all centres of one side coincide.
    #[must_use]
    pub fn fit(pairs: &[(Pose, Pose)]) -> Option<Self> {
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
        sound.then(|| Self { scale, rotation, translation: to - rotation * from * scale })
    }
}

/// Angle between two rotations, radians.
#[must_use]
pub fn angle(a: DQuat, b: DQuat) -> f64 {
    2.0 * (a.conjugate() * b).normalize().w.abs().min(1.0).acos()
}

/// The similarity that most cameras agree on. Each pair of cameras proposes one; the one that the most cameras bear out is
/// fitted to all of these. `None` if no two cameras agree.
#[must_use]
pub fn align(from: &[Option<Pose>], to: &[Option<Pose>], tolerance: Tolerance) -> Option<Alignment> {
    let both: Vec<Option<(Pose, Pose)>> = from.iter().zip(to).map(|(a, b)| Some(((*a)?, (*b)?))).collect();
    let present: Vec<(Pose, Pose)> = both.iter().flatten().copied().collect();
    let alike = |similarity: &Similarity| -> Vec<bool> {
        let near = |(a, b): &(Pose, Pose)| {
            let (centre, angle) = similarity.difference(a, b);
            centre <= tolerance.centre && angle <= tolerance.angle
        };
        both.iter().map(|pair| pair.as_ref().is_some_and(near)).collect()
    };
    let count = |alike: &[bool]| alike.iter().filter(|alike| **alike).count();
    let mut best: Option<(usize, Alignment)> = None;
    let mut offer = |similarity: Similarity| {
        let alike = alike(&similarity);
        let found = count(&alike);
        if best.as_ref().is_none_or(|(most, _)| found > *most) {
            best = Some((found, Alignment { similarity, alike }));
        }
    };
    for (i, a) in present.iter().enumerate() {
        for b in &present[i + 1..] {
            if let Some(similarity) = Similarity::fit(&[*a, *b]) {
                offer(similarity);
            }
        }
    }
    let (_, mut alignment) = best?;
    for _ in 0..5 {
        let members = both.iter().zip(&alignment.alike).filter(|(_, alike)| **alike);
        let members: Vec<(Pose, Pose)> = members.filter_map(|(pair, _)| *pair).collect();
        let Some(similarity) = Similarity::fit(&members) else { break };
        let next = alike(&similarity);
        if count(&next) < count(&alignment.alike) {
            break;
        }
        let settled = next == alignment.alike;
        alignment = Alignment { similarity, alike: next };
        if settled {
            break;
        }
    }
    (count(&alignment.alike) >= 2).then_some(alignment)
}

/// Root mean square distance of the centres from their mean: the size of an arrangement.
#[must_use]
pub fn spread(poses: &[Option<Pose>]) -> f64 {
    let centres: Vec<DVec3> = poses.iter().flatten().map(Pose::centre).collect();
    let n = centres.len().max(1) as f64;
    let mean = centres.iter().sum::<DVec3>() / n;
    (centres.iter().map(|centre| centre.distance_squared(mean)).sum::<f64>() / n).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(count: usize) -> Vec<Option<Pose>> {
        let eye = |index: usize| {
            let angle = index as f64;
            DVec3::new(2.0 * angle.cos(), 0.3 * angle, 2.0 * angle.sin())
        };
        (0..count).map(|index| Some(Pose::look_at(eye(index), DVec3::ZERO, DVec3::Y))).collect()
    }

    #[test]
    fn wrong_cameras_do_not_disturb_the_alignment_and_are_found() {
        let similarity = Similarity {
            scale: 0.37,
            rotation: DQuat::from_rotation_y(1.1) * DQuat::from_rotation_x(0.4),
            translation: DVec3::new(3.0, -1.0, 2.0),
        };
        let to = ring(9);
        let mut from: Vec<Option<Pose>> = ring(9);
        // One on the other side of the ring, one turned, one missing.
        from[4] = Some(Pose::look_at(-from[4].unwrap().centre(), DVec3::ZERO, DVec3::Y));
        from[6] = from[6].map(|p| Pose { rotation: DQuat::from_rotation_z(0.3) * p.rotation, ..p });
        from[7] = None;
        let moved: Vec<Option<Pose>> =
            from.iter().map(|pose| pose.as_ref().map(|pose| similarity.pose(pose))).collect();
        let back = align(&moved, &to, Tolerance { centre: 1e-6, angle: 1e-6 }).unwrap();
        assert_eq!(back.alike, [true, true, true, true, false, true, false, false, true]);
        assert!((back.similarity.scale * 0.37 - 1.0).abs() < 1e-9);
        let (centre, angle) = back.similarity.difference(&moved[0].unwrap(), &to[0].unwrap());
        assert!(centre < 1e-9 && angle < 1e-7, "{centre} {angle}");
    }

    #[test]
    fn cameras_on_a_line_are_enough() {
        let line = |index: usize| Some(Pose::look_at(DVec3::X * index as f64, DVec3::new(1.0, 0.0, 5.0), DVec3::Y));
        let to: Vec<Option<Pose>> = (0..4).map(line).collect();
        let turn = Similarity { scale: 2.0, rotation: DQuat::from_rotation_x(0.9), translation: DVec3::Z };
        let from: Vec<Option<Pose>> = to.iter().map(|pose| pose.as_ref().map(|pose| turn.pose(pose))).collect();
        let back = align(&from, &to, Tolerance { centre: 1e-6, angle: 1e-6 }).unwrap();
        assert!(back.alike.iter().all(|alike| *alike));
        assert!(align(&from[..1], &to[..1], Tolerance { centre: 1.0, angle: 1.0 }).is_none());
    }
}
