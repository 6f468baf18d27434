//! A flag on a pole.

use std::f64::consts::TAU;

use glam::DVec3;

use super::Script;
use crate::{
    cast::Part,
    form::{Flag, Form, Wave},
    paint::Paint,
    path::{Path, Swing},
    shape::Shape,
};

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    let size = [draw.range(0, 0.85, 1.0), draw.range(1, 0.55, 0.68)];
    let foot = DVec3::new(draw.range(2, -0.6, -0.45), 0.0, script.depth());
    let top = draw.range(3, 1.6, 1.75);
    let wave = |word: u64, height: f64, number: f64, hertz: f64| Wave {
        height: height * draw.range(word, 0.8, 1.1),
        number: [number * draw.range(word + 1, 0.85, 1.1), number * draw.range(word + 2, -0.3, 0.3)],
        hertz: hertz * draw.range(word + 3, 0.8, 1.25),
        phase: draw.range(word + 4, 0.0, TAU),
    };
    let flag = Flag { size, waves: [wave(10, 0.04, 8.0, 3.2), wave(20, 0.009, 16.0, 6.5)] };
    let swing = Swing {
        hinge: foot - DVec3::Y * (top - 0.03) + DVec3::X * 0.02,
        yaw: draw.range(4, -0.1, 0.1),
        reach: draw.range(5, 0.16, 0.28),
        hertz: draw.range(6, 0.9, 1.5),
        phase: draw.range(7, 0.0, TAU),
    };
    script.furniture.more.push(Shape::Cylinder { base: foot, radius: 0.018, height: top, paint: Paint::Steel });
    let paint = Paint::Motley(draw.range(8, 0.0, 8.0) as u8, 130);
    script.cast.add("flag", vec![Part::new(Form::Flag(flag), Path::Swing(swing), paint)]).rigid = false;
}
