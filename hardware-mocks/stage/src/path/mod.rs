//! Where a part is at a time: closed forms, without state.

mod figure;
mod flight;
mod soft;
mod swing;

pub(crate) use figure::{Figure, Limb};
pub(crate) use flight::{Arena, Flight, Meeting, State, Top};
pub(crate) use soft::SoftBall;
pub(crate) use swing::Swing;

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::motion::{Ball, Fan, Pendulum};

/// Where a part is: it is at `axes * local + origin`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// Where its frame has its origin, metres.
    pub origin: DVec3,
    /// From its frame to the world: a rotation.
    pub axes: DMat3,
    /// When it is there, seconds: what bends knows how it is bent by this.
    pub t: f64,
}

impl Place {
    /// A place of the part's frame in the world.
    pub fn world(&self, local: DVec3) -> DVec3 {
        self.axes * local + self.origin
    }

    /// A place of the world in the part's frame.
    pub fn local(&self, world: DVec3) -> DVec3 {
        self.axes.transpose() * (world - self.origin)
    }
}

/// Bounds on how fast a part moves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Speed {
    /// Of its origin, metres per second.
    pub origin: f64,
    /// Of its turning, radians per second.
    pub turn: f64,
}

/// The paths there are.
#[derive(Clone, Debug)]
pub(crate) enum Path {
    /// A ball that bounces without loss, for ever.
    Ball(Ball),
    /// A ball that goes there and back at one height (y, metres).
    Hung(Ball, f64),
    /// A blade of a fan: x along it, y across.
    Blade(Fan, usize),
    /// The rod of a pendulum: y along it, from the pivot.
    Rod(Pendulum),
    /// The bob of a pendulum.
    Bob(Pendulum),
    /// Free flight from bounce to bounce.
    Flight(Flight),
    /// A limb of a figure: y along it.
    Limb(Arc<Figure>, Limb),
    /// A ball that is pressed flat on the floor.
    Soft(SoftBall),
    /// What hangs on an upright hinge.
    Swing(Swing),
}

impl Path {
    pub(crate) fn place(&self, t: f64) -> Place {
        let (origin, axes) = match self {
            Self::Ball(ball) => (ball.centre(t), ball.rotation(t)),
            Self::Hung(ball, height) => (ball.centre(t).with_y(*height), ball.rotation(t)),
            Self::Blade(fan, number) => {
                let blade = fan.blade(t, *number);
                (fan.centre, DMat3::from_cols(blade.along, blade.across, blade.normal))
            }
            Self::Rod(pendulum) => {
                let along = pendulum.pose(t).along;
                let axis = DVec3::Y.cross(pendulum.swing);
                (pendulum.pivot, DMat3::from_cols(along.cross(axis), along, axis))
            }
            Self::Bob(pendulum) => {
                let pose = pendulum.pose(t);
                (pose.bob, pose.rotation)
            }
            Self::Flight(flight) => flight.place(t),
            Self::Limb(figure, limb) => figure.place(*limb, t),
            Self::Soft(ball) => ball.place(t),
            Self::Swing(swing) => swing.place(t),
        };
        Place { origin, axes, t }
    }

    /// Bounds on the speed within `half` seconds about `t`.
    pub(crate) fn speed(&self, t: f64, half: f64) -> Speed {
        match self {
            Self::Ball(ball) | Self::Hung(ball, _) => {
                Speed { origin: ball.centre_speed_limit(), turn: ball.spin.abs() }
            }
            Self::Blade(fan, _) => Speed { origin: 0.0, turn: fan.rate.abs() },
            // The limit is that of every point.
            Self::Rod(pendulum) | Self::Bob(pendulum) => Speed { origin: pendulum.speed_limit(), turn: 0.0 },
            Self::Flight(flight) => flight.speed(t, half),
            Self::Limb(figure, limb) => figure.speed(*limb),
            Self::Soft(ball) => ball.speed(),
            Self::Swing(swing) => swing.speed(),
        }
    }
}
