//! A leaf without thickness.

use glam::DVec3;

use super::{Ray, Touch};
use crate::{motion::leaf_half_width, path::Place, texture::interval};

pub(super) fn touch(ray: &Ray, limit: f64, place: &Place, [root, tip]: [f64; 2], width: f64) -> Option<Touch> {
    let (x, y, z) = (place.axes.x_axis, place.axes.y_axis, place.axes.z_axis);
    let facing = ray.direction.dot(z);
    let offset = place.origin - ray.origin;
    let distance = offset.dot(z) / facing;
    if !(distance > 0.0 && distance < limit) {
        return None;
    }
    let from_hub = ray.direction * distance - offset;
    let (along, across) = (from_hub.dot(x), from_hub.dot(y));
    // How far the cone spreads over the blade in either of its directions: the foreshortening of a slanted plane.
    let cone = distance * ray.spread;
    let spread = |axis: DVec3| cone * 1.0_f64.hypot(ray.direction.dot(axis) / facing);
    let (width_along, width_across) = (spread(x), spread(y));
    let cover = interval(along - 0.5 * (root + tip), 0.5 * (tip - root), width_along)
        * interval(across, leaf_half_width([root, tip], width, along), width_across);
    if cover <= 0.0 {
        return None;
    }
    let normal = if facing > 0.0 { -z } else { z };
    let footprint = width_along.min(width_across).min(0.5);
    let surface = DVec3::new(along, across, 0.0);
    Some(Touch { distance, cover, at: ray.origin + ray.direction * distance, normal, surface, footprint })
}
