//! Places on the surfaces of shapes, evenly by area.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{Form, Sample};
use crate::motion::leaf_half_width;

/// The golden ratio's fractional part.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

impl Form {
    /// Its area, square metres.
    pub(crate) fn area(&self) -> f64 {
        match *self {
            Self::Ball { radius } => 2.0 * TAU * radius * radius,
            Self::Blade { span: [root, tip], width } => 1.4 * (tip - root) * width,
            Self::Rod { length, radius } => TAU * radius * length,
            Self::Block { half } => 8.0 * (half.x * half.y + half.y * half.z + half.z * half.x),
            Self::Capsule { half, radius } => 2.0 * TAU * radius * (half + radius),
            Self::Disc { radius } => TAU * radius * radius,
            Self::Soft(ref ball) => 2.0 * TAU * ball.radius * ball.radius,
            Self::Flag(ref flag) => flag.size[0] * flag.size[1],
        }
    }

    /// `count` places on it.
    pub(crate) fn samples(&self, count: usize) -> Vec<Sample> {
        (0..count).filter_map(|index| self.sample((index as f64 + 0.5) / count as f64, index)).collect()
    }

    /// The place for `u` in (0, 1); the other coordinate follows from the index by the golden ratio. None where a leaf is narrower.
    fn sample(&self, u: f64, index: usize) -> Option<Sample> {
        let v = (index as f64 * GOLDEN).fract();
        let (sin, cos) = (TAU * v).sin_cos();
        // What is flat has two sides.
        let side = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
        Some(match *self {
            Self::Ball { radius } => {
                let normal = on_ball(u, sin, cos);
                Sample { position: normal * radius, normal, surface: normal }
            }
            Self::Blade { span: [root, tip], width } => {
                let (along, across) = (root + (tip - root) * u, width * (v - 0.5));
                let position = DVec3::new(along, across, 0.0);
                let inside = across.abs() < leaf_half_width([root, tip], width, along);
                return inside.then_some(Sample { position, normal: DVec3::Z * side, surface: position });
            }
            Self::Rod { length, radius } => {
                let normal = DVec3::new(cos, 0.0, sin);
                let position = normal * radius + DVec3::Y * (length * u);
                Sample { position, normal, surface: DVec3::new(0.0, length * u, 0.0) }
            }
            Self::Block { half } => on_block(half, u, v),
            Self::Capsule { half, radius } => {
                let caps = radius / (half + radius);
                let normal = if u < caps { on_ball(u / caps, sin, cos) } else { DVec3::new(cos, 0.0, sin) };
                let down =
                    if u < caps { half * normal.y.signum() } else { half * (2.0 * (u - caps) / (1.0 - caps) - 1.0) };
                let position = normal * radius + DVec3::Y * down;
                Sample { position, normal, surface: position }
            }
            Self::Soft(ref ball) => {
                let normal = on_ball(u, sin, cos);
                Sample { position: normal * ball.radius, normal, surface: normal }
            }
            Self::Flag(ref flag) => {
                let position = DVec3::new(flag.size[0] * u, flag.size[1] * v, 0.0);
                Sample { position, normal: DVec3::Z, surface: position }
            }
            Self::Disc { radius } => {
                let position = DVec3::new(cos, sin, 0.0) * (radius * u.sqrt());
                Sample { position, normal: DVec3::Z * side, surface: position + DVec3::Z * (side * radius) }
            }
        })
    }
}

fn on_ball(u: f64, sin: f64, cos: f64) -> DVec3 {
    let y = 1.0 - 2.0 * u;
    let ring = (1.0 - y * y).max(0.0).sqrt();
    DVec3::new(ring * cos, y, ring * sin)
}

fn on_block(half: DVec3, u: f64, v: f64) -> Sample {
    let areas = [half.y * half.z, half.z * half.x, half.x * half.y];
    let total: f64 = areas.iter().sum();
    // Which pair of faces, which of the two, and how far along it.
    let mut share = u * total;
    let mut axis = 0;
    while axis < 2 && share >= areas[axis] {
        share -= areas[axis];
        axis += 1;
    }
    let within = 2.0 * (share / areas[axis]).clamp(0.0, 1.0 - 1e-9);
    let (side, along) = (if within < 1.0 { -1.0 } else { 1.0 }, 2.0 * within.fract() - 1.0);
    let (mut position, mut normal) = (DVec3::ZERO, DVec3::ZERO);
    normal[axis] = side;
    position[axis] = side * half[axis];
    position[(axis + 1) % 3] = along * half[(axis + 1) % 3];
    position[(axis + 2) % 3] = (2.0 * v - 1.0) * half[(axis + 2) % 3];
    Sample { position, normal, surface: position }
}
