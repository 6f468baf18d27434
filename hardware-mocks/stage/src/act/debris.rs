//! Forty small pieces that fly out of a pot.
//!
//! Until then they lie in it, where nothing sees them: each comes into view through the pot's mouth.

use glam::DVec3;

use super::Script;
use crate::{
    cast::Part,
    form::Form,
    paint::Paint,
    path::{Arena, Flight, Path, Top},
    set::ROOM_LOW,
    shape::Shape,
};

/// How many.
const PIECES: usize = 40;
/// The pot's height and radius, metres.
const POT: [f64; 2] = [0.45, 0.16];

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    let [height, mouth] = POT;
    let base = DVec3::new(draw.range(0, -0.35, 0.35), 0.0, script.depth());
    script.furniture.more.push(Shape::Cylinder { base, radius: mouth, height, paint: Paint::Steel });
    let begin = script.seconds * draw.range(1, 0.15, 0.3);
    for number in 0..PIECES {
        let draw = draw.of(number);
        let size = draw.range(0, 0.018, 0.036);
        let (name, form, top) = match number % 4 {
            0 => ("chip", Form::Disc { radius: 1.3 * size }, Top::disc(DVec3::Z)),
            1 => ("splinter", Form::Capsule { half: 1.4 * size, radius: 0.4 * size }, Top::rod(DVec3::Y, 0.4, 1.4)),
            2 => ("pebble", Form::Ball { radius: size }, Top::BALL),
            _ => ("crumb", Form::Block { half: DVec3::new(0.7, 1.1, 0.7) * size }, Top::square_box(DVec3::Y, 0.7, 1.1)),
        };
        let reach = form.reach();
        let inside = DVec3::new(draw.range(1, -1.0, 1.0), 0.0, draw.range(2, -1.0, 1.0)) * (0.6 * (mouth - reach));
        let at = base + inside - DVec3::Y * (height - reach - 0.01);
        let up = draw.range(3, 2.4, 4.6);
        let aside = DVec3::new(draw.range(4, -1.0, 1.0), 0.0, draw.range(5, -0.7, 0.7)) * 1.4;
        let t = begin + draw.range(6, 0.0, 0.04);
        let arena = Arena {
            low: DVec3::new(-1.6, ROOM_LOW.y + reach, -0.8),
            high: DVec3::new(1.6, -reach, 0.4),
            restitution: 0.6,
            grip: None,
        };
        let state = draw.state(at, aside - DVec3::Y * up, draw.range(7, 8.0, 30.0));
        let flight = Flight::launched(t, &state, top, &arena, script.seconds + super::MARGIN);
        // For a ball the cells are thousandths of the radius.
        let cell = if number % 4 == 2 { 700 } else { (900.0 * size) as u16 };
        let part = Part::new(form, Path::Flight(flight), Paint::Motley(draw.range(8, 0.0, 8.0) as u8, cell));
        // Through the mouth once it has risen by its own size.
        script.cast.add(&format!("{name}-{number:02}"), vec![part]).appears = t + 2.0 * reach / up;
    }
}
