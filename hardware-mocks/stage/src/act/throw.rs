//! Balls that are thrown: one meets the floor, one the back wall, and a third is on its way.

use glam::DVec3;

use super::{Draw, Script};
use crate::{
    cast::Part,
    form::Form,
    paint::Paint,
    path::{Arena, Flight, Meeting, Path, State, Top},
    set::ROOM_HIGH,
};

pub(super) fn enter(script: &mut Script) {
    for (number, name) in ["ball", "wall-ball", "plain-ball"].into_iter().enumerate() {
        let draw = script.draw.of(number);
        let radius = draw.range(0, 0.085, 0.125);
        let arena = Arena { grip: Some(radius), ..script.arena(radius, draw.range(1, 0.75, 0.92)) };
        let t = script.seconds * draw.range(2, 0.35, 0.65);
        let meeting = match number {
            0 => floor(script, draw, radius, &arena, t),
            1 => wall(draw, radius, &arena, t),
            _ => Meeting::none(t, flying(script, draw)),
        };
        let flight = Flight::through(&meeting, Top::BALL, &arena, script.span());
        let paint =
            if number == 2 { Paint::Plain(draw.range(3, 0.0, 8.0) as u8) } else { Paint::Motley(look(draw), 420) };
        script.cast.add(name, vec![Part::new(Form::Ball { radius }, Path::Flight(flight), paint).shaded(radius)]);
    }
}

fn look(draw: Draw) -> u8 {
    draw.range(4, 0.0, 8.0) as u8
}

/// It comes down, and goes up again.
fn floor(script: &Script, draw: Draw, radius: f64, arena: &Arena, t: f64) -> Meeting {
    let at = DVec3::new(draw.range(10, -0.5, 0.5), -radius, script.depth());
    let down = draw.range(11, 3.0, 4.5);
    let velocity = DVec3::new(draw.range(12, 1.2, 2.6) * draw.sign(13), down, draw.range(14, -0.3, 0.3));
    let before = draw.state(at, velocity, draw.range(15, 5.0, 14.0));
    Meeting { t, before, after: arena.bounced(before, DVec3::NEG_Y) }
}

/// It flies to the back wall between the furniture, and comes back.
fn wall(draw: Draw, radius: f64, arena: &Arena, t: f64) -> Meeting {
    let at = DVec3::new(draw.range(10, -0.2, 0.05), draw.range(11, -1.35, -1.1), ROOM_HIGH.z - radius);
    let velocity = DVec3::new(draw.range(12, -0.25, 0.25), draw.range(13, -0.8, 0.4), draw.range(14, 3.0, 4.0));
    let before = draw.state(at, velocity, draw.range(15, 5.0, 14.0));
    Meeting { t, before, after: arena.bounced(before, DVec3::NEG_Z) }
}

/// It is half way.
fn flying(script: &Script, draw: Draw) -> State {
    let at = DVec3::new(draw.range(10, -0.3, 0.3), draw.range(11, -1.6, -1.2), script.depth());
    let velocity =
        DVec3::new(draw.range(12, 1.6, 3.2) * draw.sign(13), draw.range(14, -1.0, 0.0), draw.range(15, -0.3, 0.3));
    draw.state(at, velocity, draw.range(16, 2.0, 8.0))
}
