//! A ball before the lamp, above what the cameras see: only its shadow shows, on the back wall.

use super::Script;
use crate::{cast::Part, form::Form, light::Light, motion::Ball, paint::Paint, path::Path, set::ROOM_HIGH};

/// So far on the way from the lamp to the wall the ball is: its shadow is larger by the inverse.
const SHARE: f64 = 0.13;
/// Where the shadow goes: x and height on the wall, metres.
const SWEEP: [f64; 2] = [-1.0, 1.1];
const HEIGHT: f64 = -1.0;

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    let lamp = Light::default().position;
    let before = |from: f64, to: f64| from + SHARE * (to - from);
    let x_range = SWEEP.map(|x| before(lamp.x, x));
    let z = before(lamp.z, ROOM_HIGH.z);
    // There and back at one height, as what is pulled along a wire.
    let ball = Ball {
        radius: draw.range(0, 0.035, 0.055),
        x_range,
        z_range: [z - 0.02, z + 0.02],
        start: [draw.range(1, x_range[0], x_range[1]), z],
        velocity: [SHARE * draw.range(2, 2.0, 5.0) * draw.sign(3), SHARE * draw.range(4, -0.4, 0.4)],
        apex: 0.0,
        since_bounce: 0.0,
        spin_axis: draw.direction(5),
        spin: 5.0,
    };
    let radius = ball.radius;
    let path = Path::Hung(ball, before(lamp.y, HEIGHT));
    script.cast.add("unseen-ball", vec![Part::new(Form::Ball { radius }, path, Paint::Plain(1)).shaded(radius)]);
}
