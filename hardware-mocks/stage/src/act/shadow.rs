//! A ball before the lamp, above what the cameras see: only its shadow shows.

use super::Script;
use crate::{
    cast::Part,
    form::Form,
    motion::Ball,
    paint::Paint,
    path::Path,
};

/// Below the lamp, and above every picture, metres.
const HEIGHT: f64 = -2.12;

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    let speed = draw.range(0, 0.5, 1.1);
    // There and back along x and along z, at one height: what hangs from a thread and is pulled.
    let ball = Ball {
        radius: draw.range(1, 0.05, 0.075),
        x_range: [-0.78, -0.36],
        z_range: [-0.95, -0.75],
        start: [draw.range(2, -0.7, -0.45), draw.range(3, -0.92, -0.78)],
        velocity: [speed * draw.sign(4), 0.4 * speed * draw.sign(5)],
        apex: 0.0,
        since_bounce: 0.0,
        spin_axis: draw.direction(6),
        spin: 5.0,
    };
    let radius = ball.radius;
    let part = Part::new(Form::Ball { radius }, Path::Hung(ball, HEIGHT), Paint::Plain(1)).shaded(radius);
    script.cast.add("unseen-ball", vec![part]);
}
