//! A ball.

use super::{Ray, Touch};
use crate::{path::Place, texture::step};

pub(super) fn touch(ray: &Ray, limit: f64, place: &Place, radius: f64) -> Option<Touch> {
    let centre = place.origin;
    let offset = centre - ray.origin;
    let along = offset.dot(ray.direction);
    if along <= 0.0 {
        return None;
    }
    let miss = (offset.length_squared() - along * along).max(0.0).sqrt();
    let width = along * ray.spread;
    let cover = step(radius - miss, width);
    if cover <= 0.0 {
        return None;
    }
    let distance = along - (radius * radius - miss * miss).max(0.0).sqrt();
    if !(distance > 0.0 && distance < limit) {
        return None;
    }
    let normal = (ray.origin + ray.direction * distance - centre).normalize();
    let surface = place.axes.transpose() * normal;
    Some(Touch { distance, cover, at: centre + normal * radius, normal, surface, footprint: width / radius })
}
