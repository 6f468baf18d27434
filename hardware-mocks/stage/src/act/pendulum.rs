//! A ball on a rod.

use std::f64::consts::TAU;

use super::Script;
use crate::{cast::rod_and_bob, motion::Pendulum};

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    let pendulum = Pendulum {
        length: draw.range(0, 0.7, 1.1),
        bob_radius: draw.range(1, 0.09, 0.13),
        amplitude: draw.range(2, 0.5, 0.85),
        phase: draw.range(3, 0.0, TAU),
        ..Pendulum::default()
    };
    script.cast.add("pendulum", rod_and_bob(&pendulum));
    script.furniture.pendulum = Some(pendulum);
}
