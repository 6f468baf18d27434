//! A box.
//!
//! Its outline is that of the sum of its three half edges: the ray lies within it as far as it lies within the strip along each
//! of them. Its faces count by how much of the cone falls on each, so that an edge that passes a ray changes it gradually.

use glam::DVec3;

use super::{Ray, Touch};
use crate::{path::Place, texture::interval};

pub(super) fn touch(ray: &Ray, limit: f64, place: &Place, half: DVec3) -> Option<Touch> {
    let to_local = place.axes.transpose();
    let (origin, direction) = (to_local * (ray.origin - place.origin), to_local * ray.direction);
    let along = -origin.dot(direction);
    if along <= 0.0 {
        return None;
    }
    let width = along * ray.spread;
    let cover = outline(origin, direction, half, width);
    if cover <= 0.0 {
        return None;
    }
    let (mut sum, mut distance, mut normal) = (0.0, 0.0, DVec3::ZERO);
    for axis in 0..3 {
        let speed = direction[axis];
        if speed == 0.0 {
            continue;
        }
        let side = -speed.signum();
        let hit = (half[axis] * side - origin[axis]) / speed;
        let at = origin + direction * hit;
        // A face that is hardly seen covers nothing.
        let mut share = 1e-9;
        let mut inside = 1.0;
        for other in (0..3).filter(|&other| other != axis) {
            let footprint = width * 1.0_f64.hypot(direction[other] / speed);
            inside *= interval(at[other], half[other], footprint);
        }
        share += inside * speed.abs();
        let middle = hit.clamp(along - half.length(), along + half.length());
        sum += share;
        distance += share * middle;
        normal[axis] = share * side;
    }
    let distance = distance / sum;
    if !(distance > 0.0 && distance < limit) {
        return None;
    }
    let surface = (origin + direction * distance).clamp(-half, half);
    let normal = place.axes * (normal / sum).normalize();
    let slant = (-normal.dot(ray.direction)).max(0.05).sqrt();
    Some(Touch { distance, cover, at: place.world(surface), normal, surface, footprint: width / slant })
}

/// The share of the cone within the outline.
fn outline(origin: DVec3, direction: DVec3, half: DVec3, width: f64) -> f64 {
    // Half edges and centre across the ray.
    let across = |v: DVec3| v - direction * v.dot(direction);
    let edges = [DVec3::X * half.x, DVec3::Y * half.y, DVec3::Z * half.z].map(across);
    let centre = across(-origin);
    let mut cover: f64 = 1.0;
    for edge in edges {
        let (normal, length) = direction.cross(edge).normalize_and_length();
        if length < 1e-12 {
            continue;
        }
        let reach: f64 = edges.iter().map(|edge| edge.dot(normal).abs()).sum();
        let inside = interval(centre.dot(normal), reach, width);
        // An edge that is seen from its end bounds nothing.
        cover = cover.min(1.0 - (1.0 - inside) * (length / width).min(1.0));
    }
    cover
}
