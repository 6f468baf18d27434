//! A rod with round ends.

use glam::DVec3;

use super::{Ray, Touch};
use crate::{path::Place, texture::interval};

pub(super) fn touch(ray: &Ray, limit: f64, place: &Place, half: f64, radius: f64) -> Option<Touch> {
    let to_local = place.axes.transpose();
    let (origin, direction) = (to_local * (ray.origin - place.origin), to_local * ray.direction);
    let (along, down) = approach(origin, direction, half);
    if along <= 0.0 {
        return None;
    }
    let miss = (origin + direction * along - DVec3::Y * down).length();
    let width = along * ray.spread;
    let cover = interval(miss, radius, width);
    if cover <= 0.0 {
        return None;
    }
    let distance = if miss < radius { hit(origin, direction, half, radius).unwrap_or(along) } else { along };
    if !(distance > 0.0 && distance < limit) {
        return None;
    }
    let at = origin + direction * distance;
    let core = DVec3::Y * at.y.clamp(-half, half);
    let normal = (at - core).normalize_or(-direction);
    let surface = core + normal * radius;
    Some(Touch { distance, cover, at: place.world(surface), normal: place.axes * normal, surface, footprint: width })
}

/// Where the ray's line comes nearest to the core: the distance along it, and the place on the core.
fn approach(origin: DVec3, direction: DVec3, half: f64) -> (f64, f64) {
    let cosine = direction.y;
    let (along_ray, along_core) = (-origin.dot(direction), -origin.y);
    let sine2 = 1.0 - cosine * cosine;
    let down = if sine2 > 1e-12 { (cosine * along_ray - along_core) / sine2 } else { 0.0 };
    let down = down.clamp(-half, half);
    (along_ray + cosine * down, down)
}

/// The first meeting of a ray with the surface.
fn hit(origin: DVec3, direction: DVec3, half: f64, radius: f64) -> Option<f64> {
    let a = 1.0 - direction.y * direction.y;
    let b = origin.dot(direction) - origin.y * direction.y;
    let c = origin.length_squared() - origin.y * origin.y - radius * radius;
    if a > 1e-12 {
        let root = b * b - a * c;
        if root < 0.0 {
            return None;
        }
        let distance = (-b - root.sqrt()) / a;
        if (origin.y + direction.y * distance).abs() <= half {
            return Some(distance);
        }
    }
    let cap = |end: f64| {
        let offset = origin - DVec3::Y * end;
        let b = offset.dot(direction);
        let root = b * b - offset.length_squared() + radius * radius;
        (root >= 0.0).then(|| -b - root.sqrt())
    };
    [cap(-half), cap(half)].into_iter().flatten().min_by(f64::total_cmp)
}
