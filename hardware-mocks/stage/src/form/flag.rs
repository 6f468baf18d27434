//! A flag: a patch of cloth that waves.
//!
//! Its frame has x along it from the pole, y downwards, and z across; the cloth is at z = `lift(x, y, t)`. Its waves are so flat that
//! a ray from anywhere before it meets it once.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{Ray, Touch};
use crate::{path::Place, texture::interval};

/// A wave on the cloth: it grows from nothing at the pole.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wave {
    /// Metres at the free end.
    pub height: f64,
    /// Radians per metre along x and along y.
    pub number: [f64; 2],
    /// Hertz.
    pub hertz: f64,
    /// Radians.
    pub phase: f64,
}

/// A rectangle of cloth.
#[derive(Clone, Debug)]
pub(crate) struct Flag {
    /// Width from the pole and height, metres.
    pub size: [f64; 2],
    pub waves: [Wave; 2],
}

/// Beyond the free end waves grow no more than so much.
const BEYOND: f64 = 1.2;

impl Flag {
    /// How far the cloth is lifted, and its slopes along x and y.
    pub(crate) fn lift(&self, x: f64, y: f64, t: f64) -> [f64; 3] {
        let grown = (x / self.size[0]).clamp(0.0, BEYOND);
        let growth = if (0.0..BEYOND * self.size[0]).contains(&x) { 1.0 / self.size[0] } else { 0.0 };
        let mut sum = [0.0; 3];
        for wave in self.waves {
            let turned = (TAU * wave.hertz * t).rem_euclid(TAU);
            let (sin, cos) = (wave.number[0] * x + wave.number[1] * y - turned + wave.phase).sin_cos();
            sum[0] += wave.height * grown * sin;
            sum[1] += wave.height * (growth * sin + grown * cos * wave.number[0]);
            sum[2] += wave.height * grown * cos * wave.number[1];
        }
        sum
    }

    /// It is nowhere lifted by more, metres.
    pub(crate) fn most(&self) -> f64 {
        BEYOND * self.waves.iter().map(|wave| wave.height).sum::<f64>()
    }

    /// No point of it is lifted faster, metres per second.
    pub(crate) fn bends(&self) -> f64 {
        self.waves.iter().map(|wave| BEYOND * wave.height * TAU * wave.hertz).sum()
    }

    /// Spheres that hold it.
    pub(crate) fn spheres(&self) -> Vec<(DVec3, f64)> {
        let [width, height] = self.size;
        let (columns, rows) = (4, 3);
        let (dx, dy) = (width / f64::from(columns), height / f64::from(rows));
        let radius = (0.5 * dx).hypot(0.5 * dy) + self.most();
        let of = |index: i32| {
            DVec3::new(dx * (f64::from(index % columns) + 0.5), dy * (f64::from(index / columns) + 0.5), 0.0)
        };
        (0..columns * rows).map(|index| (of(index), radius)).collect()
    }

    /// Where a ray in the flag's frame meets the cloth or what would be its continuation.
    fn meeting(&self, origin: DVec3, direction: DVec3, t: f64) -> Option<f64> {
        let most = self.most() + 1e-6;
        let gap = |s: f64| {
            let at = origin + direction * s;
            at.z - self.lift(at.x, at.y, t)[0]
        };
        let side = if direction.z > 0.0 { -most } else { most };
        let (mut near, mut far) = ((side - origin.z) / direction.z, (-side - origin.z) / direction.z);
        if !(near.is_finite() && far.is_finite()) {
            return None;
        }
        let (mut at_near, mut at_far) = (gap(near), gap(far));
        for round in 0..60 {
            if far - near < 1e-9 {
                break;
            }
            // The secant's guess; every third time the middle, which bounds the number of rounds.
            let share = if round % 3 == 2 { 0.5 } else { (at_near / (at_near - at_far)).clamp(1e-3, 1.0 - 1e-3) };
            let middle = near + (far - near) * share;
            let value = gap(middle);
            if value.abs() < 1e-12 {
                return Some(middle);
            }
            if (value > 0.0) == (at_near > 0.0) {
                (near, at_near) = (middle, value);
            } else {
                (far, at_far) = (middle, value);
            }
        }
        Some(0.5 * (near + far))
    }
}

pub(super) fn touch(ray: &Ray, limit: f64, place: &Place, flag: &Flag) -> Option<Touch> {
    let to_local = place.axes.transpose();
    let (origin, direction) = (to_local * (ray.origin - place.origin), to_local * ray.direction);
    let distance = flag.meeting(origin, direction, place.t)?;
    if !(distance > 0.0 && distance < limit) {
        return None;
    }
    let at = origin + direction * distance;
    let [_, dx, dy] = flag.lift(at.x, at.y, place.t);
    let normal = DVec3::new(-dx, -dy, 1.0).normalize();
    let facing = normal.dot(direction);
    let width = distance * ray.spread;
    let spread = |tangent: DVec3| width * 1.0_f64.hypot(direction.dot(tangent.normalize()) / facing);
    let (along, down) = (spread(DVec3::new(1.0, 0.0, dx)), spread(DVec3::new(0.0, 1.0, dy)));
    let [half_x, half_y] = flag.size.map(|size| 0.5 * size);
    let cover = interval(at.x - half_x, half_x, along) * interval(at.y - half_y, half_y, down);
    if cover <= 0.0 {
        return None;
    }
    let normal = place.axes * if facing > 0.0 { -normal } else { normal };
    let surface = DVec3::new(at.x, at.y, 0.0);
    let footprint = along.min(down);
    Some(Touch { distance, cover, at: ray.at(distance), normal, surface, footprint })
}
