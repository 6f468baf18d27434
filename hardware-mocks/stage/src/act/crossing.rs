//! Things that pass before one another, and two balls that meet.

use glam::DVec3;

use super::{Draw, Script};
use crate::{
    cast::Part,
    form::Form,
    paint::Paint,
    path::{Flight, Meeting, Path, State, Top},
};

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    let t = script.seconds * draw.range(0, 0.4, 0.6);
    let at = DVec3::new(draw.range(1, -0.25, 0.25), draw.range(2, -1.5, -1.2), script.depth() + 0.06);
    let radius = draw.range(3, 0.09, 0.12);
    let towards = DVec3::new(1.0, draw.range(4, -0.2, 0.2), 0.0).normalize();
    let speed = draw.range(5, 1.2, 2.2);
    let ball = |number: usize, side: f64| {
        let draw = draw.of(number);
        let drift = DVec3::new(0.0, draw.range(0, -0.5, -0.1), 0.0);
        draw.state(at + towards * (side * radius), drift - towards * (side * speed), draw.range(1, 4.0, 12.0))
    };
    let before = [ball(0, -1.0), ball(1, 1.0)];
    let after = met(before, towards);
    for (number, name) in ["left-ball", "right-ball"].into_iter().enumerate() {
        let meeting = Meeting { t, before: before[number], after: after[number] };
        let flight = Flight::through(&meeting, Top::BALL, &script.arena(radius, 0.85), script.span());
        let paint = Paint::Motley(2 + 3 * number as u8 + look(draw), 420);
        script.cast.add(name, vec![Part::new(Form::Ball { radius }, Path::Flight(flight), paint).shaded(radius)]);
    }
    // One passes in front of them and one behind, both ways.
    let half = DVec3::new(0.07, 0.11, 0.07);
    let passing = [
        ("box", Form::Block { half }, Top::square_box(DVec3::Y, half.x, half.y), -0.22, 1.0),
        ("rod", Form::Capsule { half: 0.16, radius: 0.04 }, Top::rod(DVec3::Y, 0.04, 0.16), 0.26, -1.0),
    ];
    for (number, (name, form, top, depth, side)) in passing.into_iter().enumerate() {
        let draw = draw.of(2 + number);
        let at = at + DVec3::new(draw.range(0, -0.1, 0.1), draw.range(1, -0.1, 0.1), depth);
        let velocity = DVec3::new(side * draw.range(2, 1.5, 2.6), draw.range(3, -0.6, 0.0), 0.0);
        let state = draw.state(at, velocity, draw.range(4, 4.0, 12.0));
        let mut arena = script.arena(form.reach(), 0.85);
        (arena.low.z, arena.high.z) = (at.z - 0.05, at.z + 0.05);
        let flight = Flight::through(&Meeting::none(t, state), top, &arena, script.span());
        let shade = 0.6 * form.reach();
        let paint = Paint::Motley(look(draw), 50);
        script.cast.add(name, vec![Part::new(form, Path::Flight(flight), paint).shaded(shade)]);
    }
}

fn look(draw: Draw) -> u8 {
    draw.range(9, 0.0, 8.0) as u8
}

/// Two balls of one mass meet without loss along the line between their centres: they trade what they had along it.
fn met([mut a, mut b]: [State; 2], line: DVec3) -> [State; 2] {
    let traded = line * (b.velocity - a.velocity).dot(line);
    a.velocity += traded;
    b.velocity -= traded;
    [a, b]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::act::Draw;

    #[test]
    fn what_meets_keeps_its_energy_and_momentum() {
        let state = |x: f64, v: DVec3| Draw(3).state(DVec3::X * x, v, 5.0);
        let before = [state(-1.0, DVec3::new(2.0, 0.5, 0.1)), state(1.0, DVec3::new(-1.0, 0.2, 0.0))];
        let after = met(before, DVec3::X);
        let momentum = |[a, b]: [State; 2]| a.velocity + b.velocity;
        let energy = |[a, b]: [State; 2]| a.velocity.length_squared() + b.velocity.length_squared();
        assert!((momentum(before) - momentum(after)).length() < 1e-12);
        assert!((energy(before) - energy(after)).abs() < 1e-12);
        assert!(after[0].velocity.x < 0.0 && after[1].velocity.x > 0.0);
    }
}
