//! One arrangement of cameras laid over another: a similarity that most of them agree on.

use erfgs_scene::Pose;
use glam::DVec3;

use crate::geometry::Similarity;

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
            if let Some(similarity) = Similarity::of_poses(&[*a, *b]) {
                offer(similarity);
            }
        }
    }
    let (_, mut alignment) = best?;
    for _ in 0..5 {
        let members = both.iter().zip(&alignment.alike).filter(|(_, alike)| **alike);
        let members: Vec<(Pose, Pose)> = members.filter_map(|(pair, _)| *pair).collect();
        let Some(similarity) = Similarity::of_poses(&members) else { break };
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
    use glam::DQuat;

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
            pose: Pose {
                rotation: DQuat::from_rotation_y(1.1) * DQuat::from_rotation_x(0.4),
                translation: DVec3::new(3.0, -1.0, 2.0),
            },
        };
        let to = ring(9);
        let mut from: Vec<Option<Pose>> = ring(9);
        // One on the other side of the ring, one turned, one missing.
        from[4] = Some(Pose::look_at(-from[4].unwrap().centre(), DVec3::ZERO, DVec3::Y));
        from[6] = from[6].map(|p| Pose { rotation: DQuat::from_rotation_z(0.3) * p.rotation, ..p });
        from[7] = None;
        let moved: Vec<Option<Pose>> =
            from.iter().map(|pose| pose.as_ref().map(|pose| similarity.of_camera(pose))).collect();
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
        let pose = Pose { rotation: DQuat::from_rotation_x(0.9), translation: DVec3::Z };
        let turn = Similarity { scale: 2.0, pose };
        let from: Vec<Option<Pose>> = to.iter().map(|pose| pose.as_ref().map(|pose| turn.of_camera(pose))).collect();
        let back = align(&from, &to, Tolerance { centre: 1e-6, angle: 1e-6 }).unwrap();
        assert!(back.alike.iter().all(|alike| *alike));
        assert!(align(&from[..1], &to[..1], Tolerance { centre: 1.0, angle: 1.0 }).is_none());
    }
}
