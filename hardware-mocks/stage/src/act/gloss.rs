//! Shiny things: dark, smooth, with a highlight that stays where the lamp is while their paint moves.

use glam::DVec3;

use super::Script;
use crate::{
    cast::Part,
    form::Form,
    paint::Paint,
    path::{Arena, Flight, Meeting, Path, Top},
};

pub(super) fn enter(script: &mut Script) {
    let radius = script.draw.range(0, 0.13, 0.16);
    let things = [
        ("shiny-ball", Form::Ball { radius }, Top::BALL, 350),
        ("shiny-pill", Form::Capsule { half: 0.13, radius: 0.085 }, Top::rod(DVec3::Y, 0.085, 0.16), 60),
    ];
    let side = script.draw.sign(1);
    for (number, (name, form, top, cell)) in things.into_iter().enumerate() {
        let draw = script.draw.of(number);
        let side = if number == 0 { side } else { -side };
        let at = DVec3::new(side * draw.range(0, 0.3, 0.45), draw.range(1, -1.6, -1.25), script.depth());
        let velocity = DVec3::new(-side * draw.range(2, 0.4, 0.9), draw.range(3, -0.6, 0.0), 0.0);
        let state = draw.state(at, velocity, draw.range(4, 5.0, 12.0));
        let t = script.seconds * draw.range(5, 0.35, 0.5);
        let arena = Arena { grip: None, ..script.arena(form.reach(), 0.85) };
        let flight = Flight::through(&Meeting::none(t, state), top, &arena, script.span());
        let shade = 0.8 * form.reach();
        let part = Part::new(form, Path::Flight(flight), Paint::Motley(8 + draw.range(6, 0.0, 3.0) as u8, cell));
        script.cast.add(name, vec![Part { gloss: draw.range(7, 0.6, 1.0), ..part.shaded(shade) }]);
    }
}
