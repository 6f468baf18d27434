//! The static set: a furnished room.

use glam::DVec3;

use super::{
    motion::{Fan, Pendulum},
    paint::Paint,
    shape::{Hit, Shape},
};

/// Lowest corner (least x, y, z) of the room, metres. y points down: the ceiling is at -2.5.
pub(crate) const ROOM_LOW: DVec3 = DVec3::new(-1.95, -2.5, -2.8);
/// Highest corner of the room, metres. The floor is at 0.
pub(crate) const ROOM_HIGH: DVec3 = DVec3::new(1.95, 0.0, 1.55);

/// What of the furniture belongs to what moves.
#[derive(Clone, Debug, Default)]
pub(crate) struct Furniture {
    /// The fan that stands on a pole.
    pub fan: Option<Fan>,
    /// The pendulum that hangs from a beam.
    pub pendulum: Option<Pendulum>,
    /// Other things that stand about.
    pub more: Vec<Shape>,
}

impl Furniture {
    /// That of the take without acts.
    pub(crate) fn ordinary() -> Self {
        Self { fan: Some(Fan::default()), pendulum: Some(Pendulum::default()), more: Vec::new() }
    }
}

/// Everything that stands still.
#[derive(Clone, Debug)]
pub(crate) struct StageSet {
    shapes: Vec<Shape>,
    pub seed: u64,
}

impl StageSet {
    pub(crate) fn new(seed: u64, furniture: &Furniture) -> Self {
        let mut shapes = vec![Shape::Room { low: ROOM_LOW, high: ROOM_HIGH }];
        // Right: a crate with a globe on it, and the drum before it.
        shapes.push(Shape::turned_box(DVec3::new(1.25, -0.3, 1.05), DVec3::new(0.32, 0.3, 0.3), 24.0, Paint::Crate));
        shapes.push(Shape::Sphere { centre: DVec3::new(1.25, -0.8, 1.05), radius: 0.2, paint: Paint::Globe });
        shapes.push(Shape::Cylinder {
            base: DVec3::new(0.55, 0.0, 1.1),
            radius: 0.2,
            height: 0.46,
            paint: Paint::Drum,
        });
        // Left: a bookcase against the wall.
        shapes.push(Shape::turned_box(DVec3::new(-1.7, -0.6, 0.86), DVec3::new(0.22, 0.6, 0.5), 0.0, Paint::Books));
        shapes.push(Shape::turned_box(
            DVec3::new(-0.15, -0.17, 1.15),
            DVec3::new(0.26, 0.17, 0.2),
            -14.0,
            Paint::Crate,
        ));
        if let Some(fan) = &furniture.fan {
            shapes.extend(mount(fan));
        }
        if let Some(pendulum) = &furniture.pendulum {
            shapes.extend(beam(pendulum));
        }
        shapes.extend(furniture.more.iter().cloned());
        Self { shapes, seed }
    }
    /// The nearest surface along a ray, and the index of its shape (the room is shape 0).
    pub(crate) fn hit(&self, origin: DVec3, direction: DVec3) -> Option<(Hit, usize)> {
        let mut nearest: Option<(Hit, usize)> = None;
        for (index, shape) in self.shapes.iter().enumerate() {
            let limit = nearest.map_or(f64::INFINITY, |(hit, _)| hit.distance);
            if let Some(hit) = shape.hit(origin, direction, limit) {
                nearest = Some((hit, index));
            }
        }
        nearest
    }

    /// Whether furniture stands between a point and another.
    pub(crate) fn blocks(&self, from: DVec3, to: DVec3) -> bool {
        let (direction, length) = (to - from).normalize_and_length();
        self.shapes.iter().any(|shape| shape.blocks(from, direction, length))
    }
}

/// A fan's foot, pole, motor and hub. The motor sits behind the blades.
fn mount(fan: &Fan) -> [Shape; 4] {
    let motor = fan.centre - fan.axis * 0.14;
    let foot = DVec3::new(motor.x, 0.0, motor.z);
    [
        Shape::Cylinder { base: foot, radius: 0.2, height: 0.05, paint: Paint::Steel },
        Shape::Cylinder { base: foot, radius: 0.03, height: -motor.y, paint: Paint::Steel },
        Shape::Sphere { centre: motor, radius: 0.11, paint: Paint::Steel },
        Shape::Sphere { centre: fan.centre, radius: 0.07, paint: Paint::Timber },
    ]
}

/// The beam that a pendulum hangs from, and its pivot.
fn beam(pendulum: &Pendulum) -> [Shape; 2] {
    let pivot = pendulum.pivot;
    let length = ROOM_HIGH.z - pivot.z + 0.12;
    let beam = DVec3::new(pivot.x, pivot.y - 0.07, ROOM_HIGH.z - 0.5 * length);
    [
        Shape::turned_box(beam, DVec3::new(0.06, 0.06, 0.5 * length), 0.0, Paint::Timber),
        Shape::Sphere { centre: pivot, radius: 0.04, paint: Paint::Steel },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Stage, StageOptions, motion::Ball};

    #[test]
    fn nothing_that_moves_touches_the_furniture() {
        let stage = Stage::new(StageOptions::default());
        let (thrown, fan, pendulum) = (Ball::default(), Fan::default(), Pendulum::default());
        // Directions spread evenly over the sphere.
        let directions: Vec<DVec3> = (0..200)
            .map(|index| {
                let y = 1.0 - (f64::from(index) + 0.5) / 100.0;
                let (sin, cos) = (2.399_963 * f64::from(index)).sin_cos();
                DVec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin)
            })
            .collect();
        let gap = |at: DVec3| {
            let hits = directions.iter().filter_map(|&direction| stage.set.hit(at, direction));
            hits.map(|(hit, _)| hit.distance).fold(f64::INFINITY, f64::min)
        };
        for tick in 0..1500 {
            let t = f64::from(tick) * 0.0173;
            let ball = thrown.centre(t);
            assert!(gap(ball) >= thrown.radius - 1e-9, "the ball at {ball}, {t} s");
            let bob = pendulum.pose(t).bob;
            assert!(gap(bob) > pendulum.bob_radius, "the bob at {bob}, {t} s");
            for blade in fan.blades(t) {
                for along in [0.15, 0.25, 0.35, 0.4] {
                    let half = fan.half_width(along);
                    assert!(gap(fan.centre + blade.along * along + blade.across * half) > 0.01);
                }
            }
            assert!((ball - bob).length() > thrown.radius + pendulum.bob_radius);
        }
    }
}
