//! A fan of any number of blades and any speed, up to a disc.

use std::f64::consts::TAU;

use super::Script;
use crate::{cast::blades, motion::Fan};

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    let turns = draw.range(1, 2.0_f64.ln(), 40.0_f64.ln()).exp();
    let fan = Fan {
        count: draw.range(0, 2.0, 7.0) as usize,
        rate: turns * TAU * draw.sign(2),
        pitch: draw.range(3, 0.2, 0.5),
        phase: draw.range(4, 0.0, TAU),
        ..Fan::default()
    };
    script.cast.add("fan", blades(&fan));
    script.furniture.fan = Some(fan);
}
