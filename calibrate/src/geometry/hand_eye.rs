//! Where two frames on one body are to each other, from how the body moved as seen in each of them.
//!
//! If A is a motion of the body told in its first frame and B the same motion told in its second one, and X takes the second
//! frame to the first, then A X = X B. The axes of the turns give the rotation, what the turns do to the shifts the translation
//! (Tsai and Lenz 1989, "A new technique for fully autonomous and efficient 3D robotics hand/eye calibration"). Turns about one
//! axis alone leave a turn about it and a shift along it open.

use erfgs_scene::Pose;
use glam::{DMat3, DQuat, DVec3};
use nalgebra::{DMatrix, Matrix3};

use crate::{linear::symmetric_eigen, statistics::median};

/// Motions with a smaller turn, radians, say nothing about the axis; of those with a greater one it may point either way.
const TURNS: std::ops::Range<f64> = 0.08..2.8;
/// A turn has the same angle in every frame; motions whose two angles differ by more, radians, come from a mistaken pose.
const SAME: f64 = 0.06;
/// Turns of less than this about the axis about which the body turned least but one, root mean square, radians, are noise.
const LEAST_SECOND: f64 = 0.06;
/// Motions that fit worse than so many times the median are left out.
const FAR: f64 = 3.0;

/// The transformation from the second frame to the first, from motions in both (first frame, second frame). `None` where
/// fewer than three of them turn, or all turn about one axis.
#[must_use]
pub fn hand_eye(motions: &[(Pose, Pose)]) -> Option<Pose> {
    let turns =
        motions.iter().map(|(a, b)| Motion { turns: [a, b].map(turn), shifts: [a, b].map(|pose| pose.translation) });
    let mut motions: Vec<Motion> = turns.filter(Motion::tells).collect();
    let mut rotation = rotation(&motions)?;
    keep(&mut motions, |motion| (motion.turns[0] - rotation * motion.turns[1]).length());
    rotation = self::rotation(&motions)?;
    let translation = translation(&motions, rotation)?;
    keep(&mut motions, |motion| motion.open(rotation, translation).length());
    let translation = self::translation(&motions, rotation)?;
    let pose = Pose { rotation, translation };
    pose.is_finite().then_some(pose)
}

/// One motion in both frames.
struct Motion {
    /// Axis times angle, radians.
    turns: [DVec3; 2],
    /// Metres.
    shifts: [DVec3; 2],
}

impl Motion {
    fn tells(&self) -> bool {
        let [a, b] = self.turns.map(DVec3::length);
        TURNS.contains(&a) && TURNS.contains(&b) && (a - b).abs() < SAME
    }

    /// What a translation does, less what it should do.
    fn open(&self, rotation: DQuat, translation: DVec3) -> DVec3 {
        let turned = DQuat::from_scaled_axis(self.turns[0]) * translation;
        turned - translation + self.shifts[0] - rotation * self.shifts[1]
    }
}

fn turn(pose: &Pose) -> DVec3 {
    let rotation = pose.rotation.normalize();
    // The shorter way round.
    (if rotation.w < 0.0 { -rotation } else { rotation }).to_scaled_axis()
}

/// Leaves out what fits much worse than most.
fn keep(motions: &mut Vec<Motion>, off: impl Fn(&Motion) -> f64) {
    let limit = FAR * median(motions.iter().map(&off)).unwrap_or(0.0) + 1e-9;
    motions.retain(|motion| off(motion) <= limit);
}

/// The rotation that takes the axes of the second frame to those of the first.
fn rotation(motions: &[Motion]) -> Option<DQuat> {
    let spread = |of: usize| {
        let sum = motions.iter().fold(DMat3::ZERO, |sum, m| {
            let axis = m.turns[of];
            sum + DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z)
        });
        let eigen = symmetric_eigen(DMatrix::from_column_slice(3, 3, &sum.to_cols_array()));
        let mut values: Vec<f64> = eigen.values.iter().map(|value| value.max(0.0) / motions.len() as f64).collect();
        values.sort_by(f64::total_cmp);
        values[1].sqrt()
    };
    if motions.len() < 3 || spread(0).min(spread(1)) < LEAST_SECOND {
        return None;
    }
    let together = motions.iter().fold(DMat3::ZERO, |sum, motion| {
        let [to, from] = motion.turns;
        sum + DMat3::from_cols(to * from.x, to * from.y, to * from.z)
    });
    let svd = Matrix3::from_column_slice(&together.to_cols_array()).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut sign = Matrix3::identity();
    sign[(2, 2)] = (u * v_t).determinant().signum();
    let rotation = u * sign * v_t;
    let rotation = DQuat::from_mat3(&DMat3::from_cols_slice(rotation.as_slice())).normalize();
    rotation.is_finite().then_some(rotation)
}

/// The translation that fits best, by least squares.
fn translation(motions: &[Motion], rotation: DQuat) -> Option<DVec3> {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for motion in motions {
        let turned = DMat3::from_quat(DQuat::from_scaled_axis(motion.turns[0])) - DMat3::IDENTITY;
        matrix += turned.transpose() * turned;
        right += turned.transpose() * (rotation * motion.shifts[1] - motion.shifts[0]);
    }
    let translation = matrix.inverse() * right;
    translation.is_finite().then_some(translation)
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    fn vector(index: u64, of: u64, scale: f64) -> DVec3 {
        let part = |axis| scale * random::normal(random::key(31, &[index, of, axis]));
        DVec3::new(part(0), part(1), part(2))
    }

    /// Motions about axes that `axis` makes of a random one, with noise of `noise` radians and metres in both frames.
    fn motions(truth: &Pose, noise: f64, axis: impl Fn(DVec3) -> DVec3) -> Vec<(Pose, Pose)> {
        let noisy = |pose: Pose, index, of| Pose {
            rotation: DQuat::from_scaled_axis(vector(index, of, noise)) * pose.rotation,
            translation: pose.translation + vector(index, of + 1, noise),
        };
        let motion = |index| {
            let rotation = DQuat::from_scaled_axis(axis(vector(index, 0, 0.4)));
            let first = Pose { rotation, translation: vector(index, 1, 0.3) };
            let second = truth.then(&first).then(&truth.inverse());
            (noisy(first, index, 2), noisy(second, index, 4))
        };
        (0..200).map(motion).collect()
    }

    #[test]
    fn what_turns_about_two_axes_tells_where_its_frames_are() {
        let truth = Pose { rotation: DQuat::from_rotation_y(3.1), translation: DVec3::new(0.3, 0.02, 0.005) };
        let mut seen = motions(&truth, 0.003, |axis| DVec3::new(axis.x, axis.y, 0.0));
        // A tenth of the poses are mistaken.
        for (number, motion) in seen.iter_mut().enumerate().filter(|(number, _)| number % 10 == 0) {
            motion.1 = Pose { rotation: DQuat::from_scaled_axis(vector(number as u64, 9, 0.5)), ..motion.0 };
        }
        let found = hand_eye(&seen).unwrap();
        let (off, turned) =
            ((found.translation - truth.translation).length(), found.rotation.angle_between(truth.rotation));
        // 0.003 m and rad in both, over some 150 motions that turn by 0.5 rad.
        assert!(off < 0.004 && turned < 0.002, "{off} m, {turned} rad");
    }

    #[test]
    fn what_turns_about_one_axis_or_not_at_all_tells_nothing() {
        let truth = Pose { rotation: DQuat::from_rotation_y(3.1), translation: DVec3::new(0.3, 0.02, 0.005) };
        assert_eq!(hand_eye(&motions(&truth, 0.003, |axis| DVec3::Z * axis.z)), None);
        assert_eq!(hand_eye(&motions(&truth, 0.003, |_| DVec3::ZERO)), None);
        assert_eq!(hand_eye(&[]), None);
        let endless = Pose { translation: DVec3::NAN, ..Pose::IDENTITY };
        assert_eq!(hand_eye(&[(endless, endless); 9]), None);
    }
}
