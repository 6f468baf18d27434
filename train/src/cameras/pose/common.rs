//! What the poses of all cameras have in common: a turn, a shift and a scale of the scene.
//!
//! Which of them is told by the pictures: a scene that is elsewhere by it moves all pictures as the poses do, as far as that goes. A
//! turn and a shift of a camera that cancel in its picture are nothing, and turns of all cameras about their own axes are for the most
//! part a shift of the scene.

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

use super::Learner;

/// Where a picture is looked at: its middle and those of its quarters, of half of its sides.
const PLACES: [[f64; 2]; 5] = [[0.0, 0.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
/// At such depths, of the scene's.
const DEPTHS: [f64; 3] = [0.75, 1.0, 1.3];
/// What pictures hardly tell is left as it is: so small a share of what they tell in all.
const RIDGE: f64 = 1e-9;

/// A turn (radians, as axis times angle), a shift (metres) and a scale (in excess of 1) around a middle.
#[derive(Clone, Copy, Debug)]
pub struct Common {
    middle: DVec3,
    turn: DVec3,
    shift: DVec3,
    scale: f64,
}

impl Common {
    /// Of cameras that turned and shifted so in the world.
    pub fn of(learners: &[Learner], moved: impl Fn(&Learner) -> [DVec3; 2]) -> Self {
        let middle = learners.iter().map(|learner| learner.pose.centre()).sum::<DVec3>() / learners.len().max(1) as f64;
        let (mut normal, mut right) = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros());
        for learner in learners {
            let ([turned, shifted], from) = (moved(learner), learner.pose.centre() - middle);
            let rotation = DMat3::from_quat(learner.pose.rotation);
            for place in places(learner) {
                let away = rotation.transpose() * place;
                // How far its place in the picture moves if the camera goes by so much in the world.
                let picture = |by: DVec3| {
                    let by = rotation * by;
                    learner.focal / place.z * (by.truncate() - by.z / place.z * place.truncate())
                };
                let axes = DVec3::AXES;
                let columns: [DVec2; 7] = std::array::from_fn(|column| match column {
                    0..3 => picture(axes[column].cross(away + from)),
                    3..6 => picture(axes[column - 3]),
                    _ => picture(from),
                });
                let own = picture(turned.cross(away) + shifted);
                for side in 0..2 {
                    let row = SVector::<f64, 7>::from_iterator(columns.iter().map(|column| column[side]));
                    normal += row * row.transpose();
                    right += row * own[side];
                }
            }
        }
        let ridge = RIDGE * normal.trace();
        let solved = (normal + SMatrix::identity() * ridge).cholesky().map(|normal| normal.solve(&right));
        let found = solved.filter(|found| found.iter().all(|value| value.is_finite())).unwrap_or_default();
        let vector = |at: usize| DVec3::new(found[at], found[at + 1], found[at + 2]);
        Self { middle, turn: vector(0), shift: vector(3), scale: found[6] }
    }

    /// How it turns and shifts a camera at `centre` in the world.
    pub fn at(&self, centre: DVec3) -> [DVec3; 2] {
        let from = centre - self.middle;
        [self.turn, self.shift + self.turn.cross(from) + self.scale * from]
    }
}

/// Places in the axes of a camera, metres.
fn places(learner: &Learner) -> impl Iterator<Item = DVec3> {
    let reach = learner.reach;
    let depths = DEPTHS.map(|share| share * learner.depth);
    depths.into_iter().flat_map(move |depth| PLACES.map(|[x, y]| depth * DVec3::new(reach * x, reach * y, 1.0)))
}
