//! A soft ball that is pressed flat where it bounces.

use super::Script;
use crate::{
    cast::Part,
    form::Form,
    paint::Paint,
    path::{Path, SoftBall},
};

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    let speed = draw.range(0, 2.6, 3.6);
    let ball = SoftBall {
        radius: draw.range(1, 0.15, 0.19),
        speed,
        contact: draw.range(2, 0.045, 0.07),
        first: script.seconds * draw.range(3, 0.3, 0.55),
        hertz: draw.range(4, 12.0, 17.0),
        x: ([-1.0, 1.0], draw.range(5, -0.3, 0.3), draw.range(6, 0.6, 1.6) * draw.sign(7)),
        z: script.depth() + 0.15,
        spin: (draw.direction(8), draw.range(9, 2.0, 7.0)),
    };
    let shade = ball.radius;
    let paint = Paint::Motley(draw.range(10, 0.0, 8.0) as u8, 420);
    let part = Part::new(Form::Soft(ball.clone()), Path::Soft(ball), paint).shaded(shade);
    script.cast.add("soft-ball", vec![part]).rigid = false;
}
