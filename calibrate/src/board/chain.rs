//! First poses of all cameras, chained through boards that two of them see at once.

use std::collections::BTreeMap;

use erfgs_scene::Pose;

use super::BoardError;

/// One camera's boards: by instant, the pose that takes the board to the camera.
pub(super) type Boards = BTreeMap<String, Pose>;

/// World-to-camera poses, the first camera's being the world.
pub(super) fn chain(names: &[String], boards: &[Boards]) -> Result<Vec<Pose>, BoardError> {
    let count = boards.len();
    let mut poses: Vec<Option<Pose>> = vec![None; count];
    if let Some(first) = poses.first_mut() {
        *first = Some(Pose::IDENTITY);
    }
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
            None => break,
        }
    }
    let (placed, apart): (Vec<_>, Vec<_>) = names.iter().zip(&poses).partition(|(_, pose)| pose.is_some());
    if !apart.is_empty() {
        let names = |group: Vec<(&String, &Option<Pose>)>| group.into_iter().map(|(name, _)| name.clone()).collect();
        return Err(BoardError::Apart { one: names(placed), other: names(apart) });
    }
    Ok(poses.into_iter().flatten().collect())
}

/// The pose from one camera to another that most of their common boards agree upon, and how many do.
fn relative(from: &Boards, to: &Boards) -> Option<(usize, Pose)> {
    let each: Vec<Pose> = from
        .iter()
        .filter_map(|(instant, board)| Some(board.inverse().then(to.get(instant)?)))
        .filter(Pose::is_finite)
        .collect();
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
            let board = |i: i32| (i.to_string(), pose(10.0 + f64::from(i)).then(camera));
            instants.into_iter().map(board).collect()
        });
        let boards = boards.collect();
        (truth, boards)
    }

    #[test]
    fn poses_chain_through_cameras_between_and_one_wrong_board_is_outvoted() {
        let (truth, mut boards) = rig();
        boards[1].insert("2".into(), pose(77.0));
        let names: Vec<String> = ["a", "b", "c"].map(String::from).into();
        let found = chain(&names, &boards).unwrap();
        for (found, truth) in found.iter().zip(&truth) {
            assert!((found.translation - truth.translation).length() < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn groups_without_a_common_board_are_named() {
        let (_, mut boards) = rig();
        boards[1].retain(|instant, _| instant.parse::<i32>().unwrap() < 4);
        let names: Vec<String> = ["a", "b", "c"].map(String::from).into();
        let message = chain(&names, &boards).unwrap_err().to_string();
        assert!(message.contains("[a, b]") && message.contains("[c]"), "{message}");
    }
}
