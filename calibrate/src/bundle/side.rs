//! A further side of a target: where it is on what was held is the same in all placements, and may be unknown.

use erfgs_scene::Pose;
use glam::{DQuat, DVec3};

use super::Parameter;

/// A side of a target beside the one whose pose a placement is, such as the back of a board.
#[derive(Clone, Debug, PartialEq)]
pub struct Side {
    /// Name, for messages.
    pub name: String,
    /// Takes points of the side's own frame to the frame that placements take to the world.
    pub pose: Pose,
    /// The point of the side, in its own frame, about which a step turns it; metres. The shift is that of this point.
    pub middle: DVec3,
    /// Whether the solver may change the pose.
    pub free: bool,
}

impl Side {
    /// Number of free parameters.
    pub(super) fn parameters(&self) -> usize {
        self.free_parameters().len()
    }

    /// The free parameters: turns about axes of the placement's frame and shifts along them.
    pub(super) fn free_parameters(&self) -> &'static [Parameter] {
        if self.free { &Parameter::POSE } else { &[] }
    }

    /// The side after a step in its free parameters.
    pub(super) fn moved(&self, step: &[f64]) -> Self {
        let mut side = self.clone();
        if let &[x, y, z, right, down, far] = step {
            let turn = DQuat::from_scaled_axis(DVec3::new(x, y, z));
            let middle = self.pose.transform(self.middle) + DVec3::new(right, down, far);
            let rotation = (turn * self.pose.rotation).normalize();
            side.pose = Pose { rotation, translation: middle - rotation * self.middle };
        }
        side
    }

    /// The derivative of where `on_target` is, in the placement's frame, by the six parameters.
    pub(super) fn derivatives(&self, on_target: DVec3) -> [DVec3; 6] {
        let arm = self.pose.rotation * (on_target - self.middle);
        let [x, y, z] = DVec3::AXES;
        [x.cross(arm), y.cross(arm), z.cross(arm), x, y, z]
    }
}
