//! The world set by where a board lay.

use erfgs_scene::Pose;
use glam::{DQuat, DVec3};

use super::{BoardError, Plate, Target, joint::Joint};
use crate::bundle::{Bundle, Placement};

/// Moves the world to the board of the instant `name`: its origin, x along its rows, z out of the sheet towards who looks at it.
/// Of a board with two sides it is the front, unless only the back was seen and it is not known where the front is.
pub(super) fn put(joint: &mut Joint, plate: &Plate, name: &str) -> Result<(), BoardError> {
    let of_name = |(index, moment): (usize, &crate::evidence::Moment)| match joint.bundle.placements.get(index) {
        Some(Placement::Board(pose)) if moment.name == name => Some((*pose, *joint.faces.get(index)?)),
        _ => None,
    };
    let Some((board, face)) = joint.moments.iter().enumerate().find_map(of_name) else {
        let known: Vec<String> = joint.moments.iter().take(8).map(|moment| moment.name.clone()).collect();
        return Err(BoardError::NoOrigin { name: name.into(), known });
    };
    // The z of chessboards and ChArUco boards goes into the sheet, and their y down it; that of AprilGrids comes out.
    let turn = match plate.target(face) {
        Target::AprilGrid { .. } => DQuat::IDENTITY,
        Target::Chessboard { .. } | Target::Charuco { .. } => DQuat::from_rotation_x(std::f64::consts::PI),
    };
    let to_board = Pose { rotation: turn, translation: DVec3::ZERO };
    move_world(&mut joint.bundle, &to_board.then(&board));
    Ok(())
}

/// Gives everything in another world, from which `to_old` leads to the present one.
fn move_world(bundle: &mut Bundle, to_old: &Pose) {
    let from_old = to_old.inverse();
    for camera in &mut bundle.cameras {
        camera.pose = to_old.then(&camera.pose);
    }
    for placement in &mut bundle.placements {
        *placement = match *placement {
            Placement::Board(pose) => Placement::Board(pose.then(&from_old)),
            Placement::Wand { middle, direction } => {
                Placement::Wand { middle: from_old.transform(middle), direction: from_old.rotation * direction }
            }
            Placement::Point(point) => Placement::Point(from_old.transform(point)),
            Placement::Fixed => Placement::Fixed,
        };
    }
}
