//! A figure of capsules that walks, runs or throws.

use std::{f64::consts::TAU, sync::Arc};

use glam::DVec3;

use super::Script;
use crate::{
    cast::Part,
    form::Form,
    paint::Paint,
    path::{Figure, Limb, Path},
};

/// So far it goes at most in a take, metres.
const WAY: f64 = 1.7;

pub(super) fn enter(script: &mut Script) {
    let draw = script.draw;
    // Walking, running, throwing: speed, strides a second, swing, knee, elbow, lean.
    let [speed, hertz, swing, knee, elbow, lean] = match draw.range(0, 0.0, 3.0) as u8 {
        0 => [1.2, 1.0, 0.5, 0.8, 0.4, 0.03],
        1 => [2.6, 1.7, 0.8, 1.5, 1.5, 0.18],
        _ => [0.6, 0.8, 0.4, 0.5, 0.7, 0.08],
    };
    let throws = (speed < 1.0).then(|| script.seconds * draw.range(1, 0.4, 0.6));
    let (sin, cos) = draw.range(2, -0.35, 0.35).sin_cos();
    let figure = Arc::new(Figure {
        middle: [draw.range(3, -0.2, 0.2), script.depth()],
        half: 0.5 * script.seconds,
        heading: DVec3::new(cos * draw.sign(4), 0.0, sin),
        speed: (speed * draw.range(5, 0.85, 1.15)).min(WAY / script.seconds),
        hertz: hertz * draw.range(6, 0.9, 1.1),
        swing,
        knee,
        elbow,
        lean,
        phase: draw.range(7, 0.0, TAU),
        throws,
    });
    let look = draw.range(8, 0.0, 8.0) as u8;
    for (number, limb) in Limb::all().into_iter().enumerate() {
        let [length, radius] = limb.size();
        let form = Form::Capsule { half: 0.5 * length, radius };
        // Trousers, a shirt, and skin are three looks.
        let own = match limb {
            Limb::Torso | Limb::UpperArm(_) => look,
            Limb::Thigh(_) | Limb::Shin(_) => look + 3,
            Limb::Head | Limb::Forearm(_) => look + 5,
            Limb::Foot(_) => look + 6,
        };
        let paint = Paint::Motley((own + number as u8 % 2) % 8, 60);
        let part = Part::new(form, Path::Limb(Arc::clone(&figure), limb), paint).shaded(radius + 0.15 * length);
        script.cast.add(&limb.name(), vec![part]);
    }
}
