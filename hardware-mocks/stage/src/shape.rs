//! The static primitives, and where a ray meets them.

use glam::{DVec2, DVec3};

use super::paint::Paint;

/// Where a ray met a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    /// Distance along the (unit) ray, metres.
    pub distance: f64,
    /// Unit normal on the side that the ray came from.
    pub normal: DVec3,
    /// What the surface looks like.
    pub paint: Paint,
    /// Coordinates on the surface, metres (spheres: the unit vector from the centre).
    pub surface: DVec3,
}

/// A static primitive.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    /// The inside of an axis-aligned box: the room.
    Room {
        low: DVec3,
        high: DVec3,
    },
    Sphere {
        centre: DVec3,
        radius: f64,
        paint: Paint,
    },
    /// A box turned by `yaw` (its cosine and sine) about the vertical.
    Box {
        centre: DVec3,
        half: DVec3,
        yaw: DVec2,
        paint: Paint,
    },
    /// An upright cylinder with caps, from `base` (its lowest point on the axis) up.
    Cylinder {
        base: DVec3,
        radius: f64,
        height: f64,
        paint: Paint,
    },
}

/// Rays that start on a surface leave it by this much, metres.
const SKIN: f64 = 1e-6;

impl Shape {
    pub(crate) fn turned_box(centre: DVec3, half: DVec3, yaw_degrees: f64, paint: Paint) -> Self {
        let (sin, cos) = yaw_degrees.to_radians().sin_cos();
        Self::Box { centre, half, yaw: DVec2::new(cos, sin), paint }
    }

    /// The nearest meeting of the ray with the surface before `limit` metres.
    pub(crate) fn hit(&self, origin: DVec3, direction: DVec3, limit: f64) -> Option<Hit> {
        match *self {
            Self::Room { low, high } => {
                let inverse = direction.recip();
                let far = ((low - origin) * inverse).max((high - origin) * inverse);
                let distance = far.min_element();
                if !(distance > SKIN && distance < limit) {
                    return None;
                }
                let axis = [far.x, far.y, far.z].iter().position(|&d| d == distance)?;
                let at = origin + direction * distance;
                let forward = direction[axis] > 0.0;
                let mut normal = DVec3::ZERO;
                normal[axis] = if forward { -1.0 } else { 1.0 };
                let (paint, surface) = match (axis, forward) {
                    (0, false) => (Paint::LeftWall, DVec3::new(at.z, at.y, 0.0)),
                    (0, true) => (Paint::RightWall, DVec3::new(at.z, at.y, 0.0)),
                    (1, false) => (Paint::Ceiling, DVec3::new(at.x, at.z, 0.0)),
                    (1, true) => (Paint::Floor, DVec3::new(at.x, at.z, 0.0)),
                    (_, true) => (Paint::BackWall, DVec3::new(at.x, at.y, 0.0)),
                    (_, false) => (Paint::FrontWall, DVec3::new(at.x, at.y, 0.0)),
                };
                Some(Hit { distance, normal, paint, surface })
            }
            Self::Sphere { centre, radius, paint } => {
                let offset = centre - origin;
                let along = offset.dot(direction);
                let discriminant = radius * radius - (offset.length_squared() - along * along);
                if discriminant <= 0.0 {
                    return None;
                }
                let distance = along - discriminant.sqrt();
                let normal = (origin + direction * distance - centre) / radius;
                (distance > SKIN && distance < limit).then_some(Hit { distance, normal, paint, surface: normal })
            }
            Self::Box { centre, half, yaw, paint } => {
                let to_local = |v: DVec3| DVec3::new(yaw.x * v.x - yaw.y * v.z, v.y, yaw.y * v.x + yaw.x * v.z);
                let to_world = |v: DVec3| DVec3::new(yaw.x * v.x + yaw.y * v.z, v.y, -yaw.y * v.x + yaw.x * v.z);
                let (origin, direction) = (to_local(origin - centre), to_local(direction));
                let inverse = direction.recip();
                let (a, b) = ((-half - origin) * inverse, (half - origin) * inverse);
                let near = a.min(b);
                let (enter, leave) = (near.max_element(), a.max(b).min_element());
                if !(enter < leave && enter > SKIN && enter < limit) {
                    return None;
                }
                let axis = [near.x, near.y, near.z].iter().position(|&d| d == enter)?;
                let mut normal = DVec3::ZERO;
                normal[axis] = -direction[axis].signum();
                let at = origin + direction * enter;
                // Each face gets its own patch of the texture, told apart by the third coordinate.
                let face = axis as f64 * 2.0 + f64::from(normal[axis] > 0.0);
                let surface = match axis {
                    0 => DVec3::new(at.z, at.y, face),
                    1 => DVec3::new(at.x, at.z, face),
                    _ => DVec3::new(at.x, at.y, face),
                };
                Some(Hit { distance: enter, normal: to_world(normal), paint, surface })
            }
            Self::Cylinder { base, radius, height, paint } => {
                let offset = origin - base;
                let (o, d) = (DVec2::new(offset.x, offset.z), DVec2::new(direction.x, direction.z));
                let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - radius * radius);
                let discriminant = b * b - a * c;
                let mut best: Option<Hit> = None;
                if discriminant > 0.0 && a > 0.0 {
                    let distance = (-b - discriminant.sqrt()) / a;
                    let y = offset.y + direction.y * distance;
                    if distance > SKIN && distance < limit && y <= 0.0 && y >= -height {
                        let at = (o + d * distance) / radius;
                        best = Some(Hit {
                            distance,
                            normal: DVec3::new(at.x, 0.0, at.y),
                            paint,
                            surface: DVec3::new(at.y.atan2(at.x) * radius, y, 0.0),
                        });
                    }
                }
                // The lid, and the underside for rays from below.
                for (lid, up) in [(-height, -1.0), (0.0, 1.0)] {
                    let distance = (lid - offset.y) / direction.y;
                    let at = o + d * distance;
                    let limit = best.map_or(limit, |hit| hit.distance);
                    if direction.y * up < 0.0
                        && distance > SKIN
                        && distance < limit
                        && at.length_squared() < radius * radius
                    {
                        let surface = DVec3::new(at.x, at.y, 1.0);
                        best = Some(Hit { distance, normal: DVec3::Y * up, paint, surface });
                    }
                }
                best
            }
        }
    }

    /// Whether anything of the surface lies within `limit` metres along the ray.
    pub(crate) fn blocks(&self, origin: DVec3, direction: DVec3, limit: f64) -> bool {
        !matches!(self, Self::Room { .. }) && self.hit(origin, direction, limit).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shapes() -> Vec<Shape> {
        vec![
            Shape::Sphere { centre: DVec3::new(0.1, -0.5, 0.2), radius: 0.4, paint: Paint::Globe },
            Shape::turned_box(DVec3::new(0.1, -0.5, 0.2), DVec3::new(0.3, 0.4, 0.2), 33.0, Paint::Crate),
            Shape::Cylinder { base: DVec3::new(0.1, -0.2, 0.2), radius: 0.3, height: 0.6, paint: Paint::Drum },
        ]
    }

    /// Whether a point is inside, from the definition of each shape.
    fn inside(shape: &Shape, p: DVec3) -> bool {
        match *shape {
            Shape::Room { low, high } => p.cmpgt(low).all() && p.cmplt(high).all(),
            Shape::Sphere { centre, radius, .. } => (p - centre).length() < radius,
            Shape::Box { centre, half, yaw, .. } => {
                let v = p - centre;
                let local = DVec3::new(yaw.x * v.x - yaw.y * v.z, v.y, yaw.y * v.x + yaw.x * v.z);
                local.abs().cmplt(half).all()
            }
            Shape::Cylinder { base, radius, height, .. } => {
                let v = p - base;
                v.y < 0.0 && v.y > -height && v.x.hypot(v.z) < radius
            }
        }
    }

    proptest! {
        #[test]
        fn a_hit_is_the_first_entry_into_the_shape(
            ox in -2.0..2.0_f64, oy in -2.0..2.0_f64, oz in -3.0..-1.0_f64,
            tx in -0.6..0.8_f64, ty in -1.2..0.2_f64, tz in -0.4..0.8_f64,
        ) {
            let origin = DVec3::new(ox, oy, oz);
            let direction = (DVec3::new(tx, ty, tz) - origin).normalize();
            for shape in shapes() {
                let hit = shape.hit(origin, direction, 10.0);
                let marched = (0..10_000).map(|i| f64::from(i) * 5e-4).find(|&s| inside(&shape, origin + direction * s));
                match (hit, marched) {
                    (Some(hit), Some(entry)) => {
                        prop_assert!((hit.distance - entry).abs() < 1e-3, "{shape:?}: {} and {entry}", hit.distance);
                        prop_assert!(hit.normal.dot(direction) <= 1e-9 && (hit.normal.length() - 1.0).abs() < 1e-9);
                    }
                    (None, None) => {}
                    // A ray may clip an edge between two steps of the march.
                    (Some(hit), None) => {
                        let past = origin + direction * (hit.distance + 1e-6);
                        prop_assert!(inside(&shape, past) || hit.normal.dot(direction).abs() < 0.05, "{shape:?}");
                    }
                    (None, Some(entry)) => prop_assert!(false, "{shape:?} missed at {entry}"),
                }
            }
        }
    }
}
