//! A ball that is pressed flat or drawn long along the world's axes.

use glam::DVec3;

use super::{Ray, Touch};
use crate::{path::Place, texture::step};

/// With half axes `axes`, metres.
pub(super) fn touch(ray: &Ray, limit: f64, place: &Place, axes: DVec3) -> Option<Touch> {
    // Where it is a ball of radius 1.
    let (origin, direction) = ((ray.origin - place.origin) / axes, ray.direction / axes);
    let (direction, stretch) = direction.normalize_and_length();
    let along = -origin.dot(direction);
    if along <= 0.0 {
        return None;
    }
    let (aside, miss) = (origin + direction * along).normalize_and_length();
    let width = along / stretch * ray.spread;
    // How much the miss grows by a metre across the ray.
    let slope = (aside / axes).length().max(1e-9);
    let cover = step((1.0 - miss) / slope, width);
    if cover <= 0.0 {
        return None;
    }
    let unit = along - (1.0 - miss * miss).max(0.0).sqrt();
    let distance = unit / stretch;
    if !(distance > 0.0 && distance < limit) {
        return None;
    }
    let on_ball = (origin + direction * unit).normalize();
    let normal = (on_ball / axes).normalize();
    let surface = place.axes.transpose() * on_ball;
    let footprint = width / axes.min_element();
    Some(Touch { distance, cover, at: place.origin + on_ball * axes, normal, surface, footprint })
}
