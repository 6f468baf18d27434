//! What swings about an upright hinge.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::Speed;

/// A swing to and fro about the vertical through a place.
#[derive(Clone, Debug)]
pub(crate) struct Swing {
    /// Where the frame has its origin, metres.
    pub hinge: DVec3,
    /// The middle of its way, radians: its x axis is turned by so much from the world's x towards z.
    pub yaw: f64,
    /// How far it goes to either side, radians.
    pub reach: f64,
    /// How often, hertz.
    pub hertz: f64,
    /// Where it is at time 0, radians.
    pub phase: f64,
}

impl Swing {
    pub(crate) fn place(&self, t: f64) -> (DVec3, DMat3) {
        let angle = self.yaw + self.reach * ((TAU * self.hertz * t).rem_euclid(TAU) + self.phase).sin();
        let (sin, cos) = angle.sin_cos();
        let x = DVec3::new(cos, 0.0, sin);
        (self.hinge, DMat3::from_cols(x, DVec3::Y, x.cross(DVec3::Y)))
    }

    pub(crate) fn speed(&self) -> Speed {
        Speed { origin: 0.0, turn: self.reach * TAU * self.hertz }
    }
}
