//! Band-limited procedural textures.
//!
//! Every function takes the width of the footprint that it is averaged over, in the unit of its coordinates, and is
//! continuous in position: what moves past a pixel then changes its intensity continuously, which is what makes event
//! times well defined.

use erfgs_base::random;
use glam::{DVec2, DVec3};

/// Value noise in [0, 1] with one lattice point per unit, continuous with its first and second derivatives.
#[must_use]
pub fn value_noise(seed: u64, p: DVec3) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let s = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let [x, y, z] = cell.to_array().map(|v| v as i64 as u64);
    let corner = |dx: u64, dy: u64, dz: u64| {
        let (x, y, z) = (x.wrapping_add(dx), y.wrapping_add(dy), z.wrapping_add(dz));
        let word = x
            .wrapping_mul(0x9e37_79b9_7f4a_7c15)
            .wrapping_add(y.wrapping_mul(0xc2b2_ae3d_27d4_eb4f))
            .wrapping_add(z.wrapping_mul(0x1656_67b1_9e37_79f9));
        random::uniform(random::mix(seed ^ word))
    };
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let near = lerp(lerp(corner(0, 0, 0), corner(1, 0, 0), s.x), lerp(corner(0, 1, 0), corner(1, 1, 0), s.x), s.y);
    if f.z == 0.0 {
        return near;
    }
    let far = lerp(lerp(corner(0, 0, 1), corner(1, 0, 1), s.x), lerp(corner(0, 1, 1), corner(1, 1, 1), s.x), s.y);
    lerp(near, far, s.z)
}

/// A sum of `octaves` of value noise in about [-1, 1]; the coarsest has one lattice point per `cell`. Octaves finer
/// than the footprint fade out.
#[must_use]
pub fn fractal_noise(seed: u64, p: DVec3, cell: f64, octaves: u32, footprint: f64) -> f64 {
    let (mut sum, mut amplitude, mut cell) = (0.0, 1.0, cell);
    for octave in 0..octaves {
        let fade = (cell / (1.5 * footprint) - 1.0).clamp(0.0, 1.0);
        if fade == 0.0 {
            break;
        }
        let noise = value_noise(seed.wrapping_add(u64::from(octave)), p / cell);
        sum += fade * amplitude * (2.0 * noise - 1.0);
        amplitude *= 0.6;
        cell *= 0.5;
    }
    sum
}

/// The mean over a footprint of the step from 0 to 1 at `x` = 0.
#[must_use]
pub fn step(x: f64, footprint: f64) -> f64 {
    (x / footprint + 0.5).clamp(0.0, 1.0)
}

/// The mean over a footprint of the interval [-half, half] about `x` = 0. Thin intervals fade rather than flicker.
#[must_use]
pub fn interval(x: f64, half: f64, footprint: f64) -> f64 {
    let (low, high) = (x - 0.5 * footprint, x + 0.5 * footprint);
    ((high.clamp(-half, half) - low.clamp(-half, half)) / footprint).clamp(0.0, 1.0)
}

/// The mean over a footprint of a wave of period 1 that is 1 during the first `duty` of each period and 0 after.
#[must_use]
pub fn pulse(x: f64, duty: f64, footprint: f64) -> f64 {
    let integral = |x: f64| x.floor() * duty + (x - x.floor()).min(duty);
    (integral(x + 0.5 * footprint) - integral(x - 0.5 * footprint)) / footprint
}

/// Checks with cells of size 1: 1 and 0.
#[must_use]
pub fn checks(p: DVec2, footprint: f64) -> f64 {
    let wave = |x: f64| 2.0 * pulse(0.5 * x, 0.5, 0.5 * footprint) - 1.0;
    0.5 + 0.5 * wave(p.x) * wave(p.y)
}

/// Writing in cells of size 1: in each cell a random glyph of a few straight strokes, 1 on the strokes.
#[must_use]
pub fn glyphs(seed: u64, p: DVec2, footprint: f64) -> f64 {
    let cell = p.floor();
    let local = p - cell - 0.5;
    let key = random::key(seed, &[cell.x as i64 as u64, cell.y as i64 as u64]);
    let mut distance = f64::INFINITY;
    for stroke in 0..4 {
        let word = random::extend(key, stroke);
        let node = |bits: u64| {
            DVec2::new(f64::from((bits % 3) as u32) * 0.26 - 0.26, f64::from((bits / 3 % 3) as u32) * 0.3 - 0.3)
        };
        let (from, to) = (node(word & 0xffff), node(word >> 16 & 0xffff));
        let (along, offset) = (to - from, local - from);
        let u = (offset.dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
        distance = distance.min((offset - along * u).length());
    }
    step(0.085 - distance, footprint)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_wide_footprint_sees_the_mean() {
        assert!((pulse(0.3, 0.25, 1000.0) - 0.25).abs() < 1e-3);
        assert!((checks(DVec2::new(0.2, 0.7), 1000.0) - 0.5).abs() < 1e-3);
        assert!(fractal_noise(1, DVec3::ONE, 0.1, 4, 10.0).abs() < 1e-12);
        assert!((interval(0.0, 0.5, 10.0) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_narrow_footprint_sees_the_pattern() {
        assert_eq!([0.1, 0.3, 1.1].map(|x| pulse(x, 0.25, 1e-3).round()), [1.0, 0.0, 1.0]);
        let corners = [(0.5, 0.5), (1.5, 0.5), (1.5, 1.5), (-0.5, 0.5)].map(|(x, y)| checks(DVec2::new(x, y), 1e-3));
        assert_eq!(corners.map(f64::round), [1.0, 0.0, 1.0, 0.0]);
    }

    proptest! {
        #[test]
        fn textures_are_continuous_and_bounded(x in -50.0..50.0_f64, y in -50.0..50.0_f64, z in -50.0..50.0_f64, w in 0.02..2.0_f64) {
            let near = 1e-7;
            let (p, q) = (DVec3::new(x, y, z), DVec3::new(x + near, y - near, z + near));
            for (a, b) in [
                (value_noise(3, p), value_noise(3, q)),
                (fractal_noise(3, p, 1.0, 5, w), fractal_noise(3, q, 1.0, 5, w)),
                (pulse(p.x, 0.3, w), pulse(q.x, 0.3, w)),
                (checks(p.truncate(), w), checks(q.truncate(), w)),
                (interval(p.x, 0.4, w), interval(q.x, 0.4, w)),
            ] {
                prop_assert!((-2.5..=2.5).contains(&a), "{a}");
                prop_assert!((a - b).abs() < 1e-4, "{a} and {b}");
            }
            prop_assert!((0.0..=1.0).contains(&glyphs(9, p.truncate(), w)));
        }
    }
}
