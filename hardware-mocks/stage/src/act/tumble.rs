//! Boxes, a rod and a coin in free fall.

use glam::DVec3;

use super::Script;
use crate::{
    cast::Part,
    form::Form,
    paint::Paint,
    path::{Flight, Meeting, Path, Top},
};

pub(super) fn enter(script: &mut Script) {
    let brick = DVec3::new(0.075, 0.15, 0.075);
    let tile = DVec3::new(0.13, 0.13, 0.035);
    let things = [
        ("brick", Form::Block { half: brick }, Top::square_box(DVec3::Y, brick.x, brick.y)),
        ("rod", Form::Capsule { half: 0.2, radius: 0.035 }, Top::rod(DVec3::Y, 0.035, 0.2)),
        ("coin", Form::Disc { radius: 0.12 }, Top::disc(DVec3::Z)),
        ("tile", Form::Block { half: tile }, Top::square_box(DVec3::Z, tile.x, tile.z)),
    ];
    let first = script.draw.range(0, 0.0, 4.0) as usize;
    for (number, (name, form, top)) in things.into_iter().enumerate() {
        let draw = script.draw.of(number);
        // Columns of their own, in an order of the seed's.
        let column = 0.48 * ((number + first) % 4) as f64 - 0.72;
        let at = DVec3::new(column + draw.range(1, -0.06, 0.06), draw.range(2, -1.55, -1.05), script.depth());
        let velocity = DVec3::new(draw.range(3, -0.15, 0.15), 0.0, draw.range(4, -0.1, 0.1));
        let state = draw.state(at, velocity, draw.range(5, 7.0, 18.0));
        // The highest point of its way is near the middle of the take.
        let t = script.seconds * draw.range(6, 0.3, 0.6);
        let arena = script.arena(form.reach(), 0.9);
        let flight = Flight::through(&Meeting::none(t, state), top, &arena, script.span());
        let paint = Paint::Motley(draw.range(7, 0.0, 8.0) as u8, 55);
        let shade = 0.6 * form.reach();
        script.cast.add(name, vec![Part::new(form, Path::Flight(flight), paint).shaded(shade)]);
    }
}
