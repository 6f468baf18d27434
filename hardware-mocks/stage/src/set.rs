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

/// Everything that stands still.
#[derive(Clone, Debug)]
pub(crate) struct StageSet {
    shapes: Vec<Shape>,
    pub seed: u64,
}

impl StageSet {
    pub(crate) fn new(seed: u64, fan: &Fan, pendulum: &Pendulum) -> Self {
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
        // The fan's foot, pole, motor and hub. The motor sits behind the blades.
        let motor = fan.centre - fan.axis * 0.14;
        let foot = DVec3::new(motor.x, 0.0, motor.z);
        shapes.push(Shape::Cylinder { base: foot, radius: 0.2, height: 0.05, paint: Paint::Steel });
        shapes.push(Shape::Cylinder { base: foot, radius: 0.03, height: -motor.y, paint: Paint::Steel });
        shapes.push(Shape::Sphere { centre: motor, radius: 0.11, paint: Paint::Steel });
        shapes.push(Shape::Sphere { centre: fan.centre, radius: 0.07, paint: Paint::Timber });
        // The beam that the pendulum hangs from, and its pivot.
        let pivot = pendulum.pivot;
        let length = ROOM_HIGH.z - pivot.z + 0.12;
        let beam = DVec3::new(pivot.x, pivot.y - 0.07, ROOM_HIGH.z - 0.5 * length);
        shapes.push(Shape::turned_box(beam, DVec3::new(0.06, 0.06, 0.5 * length), 0.0, Paint::Timber));
        shapes.push(Shape::Sphere { centre: pivot, radius: 0.04, paint: Paint::Steel });
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Stage, StageOptions};

    #[test]
    fn nothing_that_moves_touches_the_furniture() {
        let stage = Stage::new(StageOptions::default());
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
            let ball = stage.ball.centre(t);
            assert!(gap(ball) >= stage.ball.radius - 1e-9, "the ball at {ball}, {t} s");
            let bob = stage.pendulum.pose(t).bob;
            assert!(gap(bob) > stage.pendulum.bob_radius, "the bob at {bob}, {t} s");
            for blade in stage.fan.blades(t) {
                for along in [0.15, 0.25, 0.35, 0.4] {
                    let half = stage.fan.half_width(along);
                    assert!(gap(stage.fan.centre + blade.along * along + blade.across * half) > 0.01);
                }
            }
            assert!((ball - bob).length() > stage.ball.radius + stage.pendulum.bob_radius);
        }
    }
}
