//! A disc without thickness.

use glam::DVec3;

use super::{Ray, Touch};
use crate::{path::Place, texture::interval};

pub(super) fn touch(ray: &Ray, limit: f64, place: &Place, radius: f64) -> Option<Touch> {
    let normal = place.axes.z_axis;
    let facing = ray.direction.dot(normal);
    let offset = place.origin - ray.origin;
    let distance = offset.dot(normal) / facing;
    if !(distance > 0.0 && distance < limit) {
        return None;
    }
    let from_centre = ray.direction * distance - offset;
    // Along the slant, where the cone spreads, and across it.
    let slant = (ray.direction - normal * facing).normalize_or(place.axes.x_axis);
    let (u, v) = (from_centre.dot(slant), from_centre.dot(normal.cross(slant)));
    let width = distance * ray.spread;
    let chord = (radius * radius - (v.abs() - 0.5 * width).clamp(0.0, radius).powi(2)).sqrt();
    let cover = interval(v, radius, width) * interval(u, chord, width / facing.abs());
    if cover <= 0.0 {
        return None;
    }
    let inside = from_centre.clamp_length_max(radius);
    let local = place.axes.transpose() * inside;
    // Each side has its own pattern.
    let surface = DVec3::new(local.x, local.y, if facing > 0.0 { -radius } else { radius });
    let at = place.origin + inside;
    let normal = if facing > 0.0 { -normal } else { normal };
    Some(Touch { distance, cover, at, normal, surface, footprint: width / facing.abs().max(0.05).sqrt() })
}
