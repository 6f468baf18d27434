//! Which lights are the wand.

use erfgs_scene::Intrinsics;
use glam::DVec2;

use super::{
    super::{Stick, view},
    Light,
};

/// Lights of a frequency that are tried.
const TRIED: usize = 6;

/// The LEDs among the lights of one instant, in the order of the gaps; `None` where there is no wand.
///
/// With three lists, a LED's frequency says which it is, and the line decides where a frequency has several lights. With one
/// list the line and the gaps decide; the strongest three that could be a wand are it.
#[must_use]
pub fn choose(stick: &Stick, intrinsics: &Intrinsics, by_frequency: &[Vec<Light>]) -> Option<[Option<DVec2>; 3]> {
    let could_be = |pixels: [DVec2; 3]| {
        let [a, b, c] = pixels;
        (b - a).dot(c - b) > 0.0 && view::Lone::new(stick, intrinsics, pixels).is_some_and(|lone| lone.is_likely())
    };
    let mut best: Option<(f64, [DVec2; 3])> = None;
    let mut consider = |weight: f64, pixels: [DVec2; 3]| {
        if best.is_none_or(|(most, _)| weight > most) && could_be(pixels) {
            best = Some((weight, pixels));
        }
    };
    match by_frequency {
        [a, b, c] => {
            for a in a.iter().take(TRIED) {
                for b in b.iter().take(TRIED) {
                    for c in c.iter().take(TRIED) {
                        consider(a.weight.min(b.weight).min(c.weight), [a.pixel, b.pixel, c.pixel]);
                    }
                }
            }
            if best.is_none() {
                // What is left of a wand that is partly hidden: a frequency with one light alone.
                let single = |lights: &[Light]| if let [light] = lights { Some(light.pixel) } else { None };
                let leds = [single(a), single(b), single(c)];
                let seen = leds.iter().flatten().count();
                return (seen == 2).then_some(leds);
            }
        }
        [all] => {
            let all = &all[..all.len().min(TRIED + 2)];
            for (i, a) in all.iter().enumerate() {
                for (j, b) in all.iter().enumerate().skip(i + 1) {
                    for c in &all[j + 1..] {
                        let pixels = view::label(stick, intrinsics, [a.pixel, b.pixel, c.pixel]);
                        consider(a.weight.min(b.weight).min(c.weight), pixels);
                    }
                }
            }
        }
        _ => {}
    }
    best.map(|(_, pixels)| pixels.map(Some))
}
