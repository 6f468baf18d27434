//! First poses of all cameras, chained through boards that two of them see at once.

use std::collections::BTreeMap;

use erfgs_scene::Pose;

use super::plate::Face;

/// One camera's boards: by side and instant, the pose that takes the frame of that side to the camera.
pub(super) type Boards = BTreeMap<(Face, String), Pose>;

/// A group of cameras that boards tie to each other.
pub(super) struct Chain {
    /// Indices of the group's cameras, ascending.
    pub cameras: Vec<usize>,
    /// Their world-to-camera poses; the first one is the world.
    pub poses: Vec<Pose>,
}

/// All cameras in groups that are tied to each other, those with the earliest camera first. The first camera of each group is
/// its world.
pub(super) fn groups(boards: &[Boards]) -> Vec<Chain> {
    let mut left: Vec<usize> = (0..boards.len()).collect();
    let mut groups = Vec::new();
    while let Some(&first) = left.first() {
        let poses = chain_from(first, boards);
        let (cameras, poses): (Vec<usize>, Vec<Pose>) =
            poses.into_iter().enumerate().filter_map(|(camera, pose)| Some((camera, pose?))).unzip();
        left.retain(|camera| !cameras.contains(camera));
        groups.push(Chain { cameras, poses });
    }
    groups
}

/// The largest group; of groups of the same size the first.
pub(super) fn largest(groups: Vec<Chain>) -> Chain {
    let none = Chain { cameras: Vec::new(), poses: Vec::new() };
    groups.into_iter().fold(none, |best, next| if next.cameras.len() > best.cameras.len() { next } else { best })
}

/// World-to-camera poses of the cameras that are tied to camera `first`, which is the world.
fn chain_from(first: usize, boards: &[Boards]) -> Vec<Option<Pose>> {
    let mut poses: Vec<Option<Pose>> = vec![None; boards.len()];
    poses[first] = Some(Pose::IDENTITY);
    loop {
        // The strongest tie between a camera that is placed and one that is not.
        let mut best: Option<(usize, usize, Pose)> = None;
        for (known, pose) in poses.iter().enumerate().filter_map(|(i, pose)| Some((i, pose.as_ref()?))) {
            for (new, _) in poses.iter().enumerate().filter(|(_, pose)| pose.is_none()) {
                if let Some((agree, relative)) = relative(&boards[known], &boards[new])
                    && best.as_ref().is_none_or(|(most, ..)| agree > *most)
                {
                    best = Some((agree, new, pose.then(&relative)));
                }
            }
        }
        match best {
            Some((_, new, pose)) => poses[new] = Some(pose),
            None => return poses,
        }
    }
}

/// The pose from one camera to another that most of their common boards agree upon, and how many do.
fn relative(from: &Boards, to: &Boards) -> Option<(usize, Pose)> {
    let each: Vec<Pose> =
        from.iter().filter_map(|(instant, board)| Some(board.inverse().then(to.get(instant)?))).collect();
    most_agreed(&each)
}

/// The pose that most of them agree upon, and how many do.
pub(super) fn most_agreed(each: &[Pose]) -> Option<(usize, Pose)> {
    let each: Vec<Pose> = each.iter().copied().filter(Pose::is_finite).collect();
    let agree = |a: &Pose, b: &Pose| {
        let far = (a.translation - b.translation).length() / (0.05 * a.translation.length() + 0.01);
        far.max(a.rotation.angle_between(b.rotation) / 0.05)
    };
    let votes = |pose: &Pose| each.iter().filter(|other| agree(pose, other) <= 1.0).count();
    let spread = |pose: &Pose| each.iter().map(|other| agree(pose, other).min(1.0)).sum::<f64>();
    let best = each.iter().max_by(|a, b| votes(a).cmp(&votes(b)).then(spread(b).total_cmp(&spread(a))))?;
    Some((votes(best), *best))
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    fn chain(boards: &[Boards]) -> Chain {
        largest(groups(boards))
    }

    fn pose(seed: f64) -> Pose {
        Pose {
            rotation: DQuat::from_scaled_axis(DVec3::new(seed.sin(), (2.0 * seed).cos(), 0.3 * seed)),
            translation: DVec3::new(0.1 * seed, seed.cos(), 2.0),
        }
    }

    /// Three cameras, of which the first and the last have no board in common.
    fn rig() -> (Vec<Pose>, Vec<Boards>) {
        let truth = vec![Pose::IDENTITY, pose(1.0), pose(2.0)];
        let seen = [vec![0, 1, 2, 3], vec![0, 1, 2, 3, 4, 5, 6], vec![4, 5, 6]];
        let boards = truth.iter().zip(seen).map(|(camera, instants)| {
            let board = |i: i32| ((Face::Front, i.to_string()), pose(10.0 + f64::from(i)).then(camera));
            instants.into_iter().map(board).collect()
        });
        let boards = boards.collect();
        (truth, boards)
    }

    #[test]
    fn poses_chain_through_cameras_between_and_one_wrong_board_is_outvoted() {
        let (truth, mut boards) = rig();
        boards[1].insert((Face::Front, "2".into()), pose(77.0));
        let found = chain(&boards);
        assert_eq!(found.cameras, [0, 1, 2]);
        for (found, truth) in found.poses.iter().zip(&truth) {
            assert!((found.translation - truth.translation).length() < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn of_two_groups_without_a_common_board_the_larger_is_taken() {
        let (_, mut boards) = rig();
        boards[1].retain(|(_, instant), _| instant.parse::<i32>().unwrap() < 4);
        assert_eq!(chain(&boards).cameras, [0, 1]);
        boards.insert(0, BTreeMap::new());
        assert_eq!(chain(&boards).cameras, [1, 2]);
        assert_eq!(chain(&[]).cameras, [0_usize; 0]);
    }
}
