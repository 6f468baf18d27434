//! A thin rod with open ends.

use glam::DVec3;

use super::{Ray, Touch, near_sphere};
use crate::{path::Place, texture::interval};

pub(super) fn touch(ray: &Ray, limit: f64, place: &Place, length: f64, radius: f64) -> Option<Touch> {
    let axis = place.axes.y_axis;
    let offset = place.origin - ray.origin;
    let (side, sine) = ray.direction.cross(axis).normalize_and_length();
    if sine < 1e-6 {
        return None;
    }
    let miss = offset.dot(side);
    // The nearest points of the two lines.
    let (cosine, along_ray, along_rod) = (ray.direction.dot(axis), offset.dot(ray.direction), offset.dot(axis));
    let distance = (along_ray - cosine * along_rod) / (sine * sine);
    let down = (cosine * along_ray - along_rod) / (sine * sine);
    let width = distance * ray.spread;
    if !(width > 0.0 && distance < limit) {
        return None;
    }
    let half = 0.5 * length;
    let cover = interval(miss, radius, width) * interval(down - half, half, width / sine);
    if cover <= 0.0 {
        return None;
    }
    let bulge = (miss / radius).clamp(-1.0, 1.0);
    let towards = axis.cross(side);
    let towards = if towards.dot(ray.direction) > 0.0 { -towards } else { towards };
    let normal = (towards * (1.0 - bulge * bulge).sqrt() - side * bulge).normalize();
    let (at, surface) = (ray.origin + ray.direction * distance, DVec3::new(0.0, down, 0.0));
    Some(Touch { distance, cover, at, normal, surface, footprint: width / sine })
}

/// Whether it may come within `margin` (radians) of a ray.
pub(super) fn near(ray: &Ray, margin: f64, place: &Place, length: f64, radius: f64) -> bool {
    let half = 0.5 * length;
    let axis = place.axes.y_axis;
    // The part of the rod nearest to the ray's closest approach, or its end.
    let (side, sine) = ray.direction.cross(axis).normalize_and_length();
    let offset = place.origin - ray.origin;
    let reach = radius + margin * (offset.length() + 2.0 * half);
    (sine < 0.05 || offset.dot(side).abs() <= reach)
        && near_sphere(ray, margin, place.origin + axis * half, half + radius)
}
