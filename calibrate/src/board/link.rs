//! How cameras are tied to each other where some see the front of a board and others its back.
//!
//! Cameras that see the same side at once are tied whatever lies between the sides: they make groups. Within a group the back
//! follows from every instant at which one camera sees the front and another one the back. Between two groups it follows from how
//! the board turns (`geometry/hand_eye.rs`): the one tells its motion in the frame of the front, the other the same motion in
//! that of the back. Once it is known, every camera tells where the front is, and groups grow together.

use std::collections::{BTreeMap, BTreeSet};

use erfgs_scene::Pose;

use super::{
    chain::{Boards, Chain, groups, largest, most_agreed},
    plate::Face,
};
use crate::geometry::hand_eye;

/// Instants that are looked at, at most: more of them only take time.
const MOST_WITHIN: usize = 400;
/// The same between two groups, where every two of them make a motion.
const MOST_BETWEEN: usize = 60;

/// One camera's boards as it saw them: by instant, the side and the pose that takes that side's frame to the camera.
pub(super) type Sightings = BTreeMap<String, (Face, Pose)>;

/// Where the back is on the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BackPose {
    /// Takes the frame of the back's target to that of the front's.
    pub pose: Pose,
    /// Whether it is kept as it was stated, since the views leave it open.
    pub stated: bool,
    /// Whether cameras of the chain saw both sides at one instant, so that it matters and they tell about it.
    pub seen: bool,
}

/// The cameras that are tied together, and what they saw.
pub(super) struct Linked {
    pub chain: Chain,
    /// Of all cameras, tied or not. Where it is known where the back is, all in the frame of the front.
    pub boards: Vec<Boards>,
    pub back: Option<BackPose>,
}

/// Cameras that only the board's two sides would tie, and where the back is remains open: those that saw the front, and those
/// that saw the back.
pub(super) struct Open {
    pub front: Vec<usize>,
    pub back: Vec<usize>,
}

/// Ties cameras. `stated` is where the back is said to be, which is a start where nothing else tells; with `keep` it is taken
/// whatever the views tell.
pub(super) fn link(sightings: &[Sightings], stated: Option<Pose>, keep: bool) -> Result<Linked, Open> {
    let apart: Vec<Boards> = sightings.iter().map(|own| boards(own, |face, pose| (face, pose))).collect();
    let groups = groups(&apart);
    let both = between(&groups, &apart);
    let found = within(&groups, &apart).or_else(|| motions(&both));
    let pose = match (stated, found) {
        (Some(stated), _) if keep => stated,
        (_, Some(found)) => found,
        (Some(stated), None) => stated,
        (None, None) => match both.first() {
            // One board tells nothing of the back, and these cameras are tied by nothing else.
            Some(Between { front, back, .. }) => return Err(Open { front: front.clone(), back: back.clone() }),
            None => return Ok(Linked { chain: largest(groups), boards: apart, back: None }),
        },
    };
    let to_back = pose.inverse();
    let of_front = |face: Face, board: Pose| match face {
        Face::Front => (Face::Front, board),
        Face::Back => (Face::Front, to_back.then(&board)),
    };
    let joined: Vec<Boards> = sightings.iter().map(|own| boards(own, of_front)).collect();
    let chain = largest(self::groups(&joined));
    let instants = |face: Face| -> BTreeSet<&String> {
        let tied = chain.cameras.iter().flat_map(|camera| &sightings[*camera]);
        tied.filter(|(_, (seen, _))| *seen == face).map(|(instant, _)| instant).collect()
    };
    let seen = !instants(Face::Front).is_disjoint(&instants(Face::Back));
    Ok(Linked { chain, boards: joined, back: Some(BackPose { pose, stated: keep && stated.is_some(), seen }) })
}

fn boards(own: &Sightings, framed: impl Fn(Face, Pose) -> (Face, Pose)) -> Boards {
    let board = |(instant, (face, pose)): (&String, &(Face, Pose))| {
        let (face, pose) = framed(*face, *pose);
        ((face, instant.clone()), pose)
    };
    own.iter().map(board).collect()
}

/// Where a side was in a group's world at each instant: what most of its cameras agree upon.
fn placed(group: &Chain, boards: &[Boards], face: Face) -> BTreeMap<String, Pose> {
    let mut each: BTreeMap<&String, Vec<Pose>> = BTreeMap::new();
    for (camera, pose) in group.cameras.iter().zip(&group.poses) {
        for ((_, instant), board) in boards[*camera].iter().filter(|((seen, _), _)| *seen == face) {
            each.entry(instant).or_default().push(board.then(&pose.inverse()));
        }
    }
    each.into_iter().filter_map(|(instant, poses)| Some((instant.clone(), most_agreed(&poses)?.1))).collect()
}

/// Every so many of them that no more than `most` are left.
fn thinned<T>(all: Vec<T>, most: usize) -> Vec<T> {
    let every = all.len().div_ceil(most).max(1);
    all.into_iter().step_by(every).collect()
}

/// The back, from instants at which one group saw both sides.
fn within(groups: &[Chain], boards: &[Boards]) -> Option<Pose> {
    let each = groups.iter().flat_map(|group| {
        let front = placed(group, boards, Face::Front);
        let back = placed(group, boards, Face::Back);
        let both = back.into_iter().filter_map(|(instant, back)| Some(back.then(&front.get(&instant)?.inverse())));
        both.collect::<Vec<Pose>>()
    });
    Some(most_agreed(&thinned(each.collect(), MOST_WITHIN))?.1)
}

/// Two groups of which one saw the front when the other one saw the back.
struct Between {
    front: Vec<usize>,
    back: Vec<usize>,
    /// The front in the world of the one, the back in that of the other.
    boards: Vec<(Pose, Pose)>,
}

fn between(groups: &[Chain], boards: &[Boards]) -> Vec<Between> {
    let sides = |group: &Chain| [Face::Front, Face::Back].map(|face| placed(group, boards, face));
    let placed: Vec<[BTreeMap<String, Pose>; 2]> = groups.iter().map(sides).collect();
    let mut all = Vec::new();
    for (g, [front, _]) in placed.iter().enumerate() {
        for (h, [_, back]) in placed.iter().enumerate().filter(|(h, _)| *h != g) {
            let both = front.iter().filter_map(|(instant, front)| Some((*front, *back.get(instant)?)));
            let boards = thinned(both.collect(), MOST_BETWEEN);
            if !boards.is_empty() {
                all.push(Between { front: groups[g].cameras.clone(), back: groups[h].cameras.clone(), boards });
            }
        }
    }
    all
}

/// The back, from how the board moved before two groups.
fn motions(both: &[Between]) -> Option<Pose> {
    let of_two = |boards: &[(Pose, Pose)]| -> Vec<(Pose, Pose)> {
        let pairs = boards.iter().enumerate().flat_map(|(n, to)| boards[..n].iter().map(move |from| (from, to)));
        pairs.map(|(from, to)| (from.0.then(&to.0.inverse()), from.1.then(&to.1.inverse()))).collect()
    };
    let all: Vec<(Pose, Pose)> = both.iter().flat_map(|two| of_two(&two.boards)).collect();
    hand_eye(&all)
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;
    use glam::{DQuat, DVec3};

    use super::*;

    fn back() -> Pose {
        Pose { rotation: DQuat::from_rotation_y(3.13), translation: DVec3::new(0.4, 0.003, 0.006) }
    }

    fn vector(index: u64, scale: f64) -> DVec3 {
        let part = |axis| scale * random::normal(random::key(41, &[index, axis]));
        DVec3::new(part(0), part(1), part(2))
    }

    /// Cameras on a ring of 2 m, by their angles in degrees.
    fn ring(angles: &[f64]) -> Vec<Pose> {
        let eye = |angle: &f64| 2.0 * DVec3::new(angle.to_radians().sin(), 0.0, -angle.to_radians().cos());
        angles.iter().map(|angle| Pose::look_at(eye(angle), DVec3::ZERO, DVec3::Y)).collect()
    }

    /// What they see of a board that turns by `turns` (axis times angle): the side that faces them.
    fn seen(cameras: &[Pose], turns: impl Fn(u64) -> DVec3) -> Vec<Sightings> {
        let view = |camera: &Pose, instant: u64| {
            let front = Pose { rotation: DQuat::from_scaled_axis(turns(instant)), translation: vector(instant, 0.1) };
            // The front's z points away from who looks at it.
            let facing = (front.rotation * DVec3::Z).dot(front.translation - camera.centre());
            let (face, board) = if facing > 0.0 { (Face::Front, front) } else { (Face::Back, back().then(&front)) };
            (format!("{instant}"), (face, board.then(camera)))
        };
        cameras.iter().map(|camera| (0..30).map(|instant| view(camera, instant)).collect()).collect()
    }

    fn assert_ring(linked: &Linked, cameras: &[Pose]) {
        assert_eq!(linked.chain.cameras, (0..cameras.len()).collect::<Vec<_>>());
        for (found, camera) in linked.chain.poses.iter().zip(cameras) {
            let truth = cameras[0].inverse().then(camera);
            assert!((found.translation - truth.translation).length() < 1e-6, "{found:?} {truth:?}");
        }
    }

    #[test]
    fn cameras_that_face_each_other_are_tied_by_the_two_sides() {
        // Two by two they see the same side at all times, and the other two the other side.
        let cameras = ring(&[-20.0, 20.0, 160.0, 200.0]);
        let linked = link(&seen(&cameras, |instant| vector(instant, 0.3)), None, false).ok().unwrap();
        assert_ring(&linked, &cameras);
        let found = linked.back.unwrap();
        assert!(found.seen && !found.stated && (found.pose.translation - back().translation).length() < 1e-6);
        // All around: those at the side see now the one and now the other.
        let cameras = ring(&[0.0, 90.0, 180.0, 270.0]);
        let turning = |instant: u64| DVec3::Y * instant as f64 * 0.9;
        let linked = link(&seen(&cameras, turning), None, false).ok().unwrap();
        assert_ring(&linked, &cameras);
        assert!((linked.back.unwrap().pose.translation - back().translation).length() < 1e-6);
    }

    #[test]
    fn a_board_that_turns_about_one_axis_leaves_its_back_open_until_it_is_stated() {
        let cameras = ring(&[-20.0, 20.0, 160.0, 200.0]);
        let sightings = seen(&cameras, |instant| DVec3::X * vector(instant, 0.3).x);
        let open = link(&sightings, None, false).err().unwrap();
        assert_eq!((open.front, open.back), (vec![0, 1], vec![2, 3]));
        for keep in [false, true] {
            let linked = link(&sightings, Some(back()), keep).ok().unwrap();
            assert_ring(&linked, &cameras);
            assert_eq!(linked.back, Some(BackPose { pose: back(), stated: keep, seen: true }));
        }
    }

    #[test]
    fn sides_that_are_never_seen_at_once_need_no_back() {
        let cameras = ring(&[-20.0, 20.0]);
        let sightings =
            seen(&cameras, |instant| DVec3::Y * if instant < 15 { 0.1 } else { 3.0 } + vector(instant, 0.05));
        let linked = link(&sightings, None, false).ok().unwrap();
        assert_ring(&linked, &cameras);
        assert_eq!(linked.back, None);
        assert!(!link(&sightings, Some(back()), false).ok().unwrap().back.unwrap().seen);
    }
}
