//! Shading: one round lamp with Lambert's law, ambient light that corners dim, and the soft shadows of spheres.

use glam::{DVec2, DVec3};

use super::set::{ROOM_HIGH, ROOM_LOW, StageSet};

/// The sharpness of a highlight: Blinn's exponent.
const GLOSS: i32 = 48;

/// The lamp and the ambient light.
#[derive(Clone, Debug)]
pub(crate) struct Light {
    /// Centre of the lamp, metres.
    pub position: DVec3,
    /// Radius of the lamp, metres: it makes penumbrae.
    pub radius: f64,
    /// Irradiance over pi (so that it multiplies an albedo) at 2 m, linear RGB.
    pub power: DVec3,
    /// Ambient light from above and from below, linear RGB.
    pub ambient: [DVec3; 2],
}

impl Default for Light {
    fn default() -> Self {
        Self {
            position: DVec3::new(-0.55, -2.38, -0.9),
            radius: 0.06,
            power: DVec3::new(1.02, 0.95, 0.83) * 0.95,
            ambient: [DVec3::new(0.44, 0.46, 0.50), DVec3::new(0.27, 0.235, 0.20)],
        }
    }
}

impl Light {
    /// Light from the lamp on a surface where nothing stands in between.
    pub(crate) fn direct(&self, at: DVec3, normal: DVec3) -> DVec3 {
        let (direction, distance) = (self.position - at).normalize_and_length();
        // Softer than the inverse square, as the unmodelled bounces from the walls are.
        let falloff = 1.0 / (0.35 + 0.65 * (distance / 2.0).powi(2));
        self.power * (falloff * normal.dot(direction).max(0.0))
    }

    /// Light of the lamp that a glossy surface of a moving thing sends along a ray that comes from `direction`.
    pub(crate) fn mirrored(&self, at: DVec3, normal: DVec3, direction: DVec3) -> DVec3 {
        let (to_lamp, distance) = (self.position - at).normalize_and_length();
        let middle = (to_lamp - direction).normalize_or(normal);
        let falloff = 1.0 / (0.35 + 0.65 * (distance / 2.0).powi(2));
        let faces = normal.dot(to_lamp).max(0.0);
        self.power * (falloff * faces.min(0.2) * 5.0 * normal.dot(middle).max(0.0).powi(GLOSS))
    }

    /// Ambient light on a surface, without regard to what stands about.
    pub(crate) fn ambient(&self, normal: DVec3) -> DVec3 {
        let [above, below] = self.ambient;
        below + (above - below) * (0.5 - 0.5 * normal.y)
    }

    /// How much of the ambient light reaches a place in the room: the walls nearby hide part of it.
    pub(crate) fn openness(at: DVec3, normal: DVec3) -> f64 {
        let mut open = 1.0;
        for axis in 0..3 {
            for (gap, inward) in [(at[axis] - ROOM_LOW[axis], 1.0), (ROOM_HIGH[axis] - at[axis], -1.0)] {
                let facing = 0.5 - 0.5 * normal[axis] * inward;
                open *= 1.0 - 0.45 * facing * (-gap.max(0.0) / 0.16).exp();
            }
        }
        open
    }

    /// The share of the lamp that furniture leaves visible from `at`, by `rays` points on the lamp; `turn` in [0, 1)
    /// turns the pattern, so that neighbouring samples use other points.
    pub(crate) fn visible(&self, set: &StageSet, at: DVec3, rays: u32, turn: f64) -> f64 {
        let axis = (self.position - at).normalize();
        let (u, v) = axis.any_orthonormal_pair();
        let lit = (0..rays).filter(|&ray| {
            // A sunflower: equal areas, golden angles.
            let radius = self.radius * ((f64::from(ray) + 0.5) / f64::from(rays)).sqrt();
            let angle = std::f64::consts::TAU * (f64::from(ray) * 0.618_033_988_75 + turn);
            let offset = DVec2::from_angle(angle) * radius;
            !set.blocks(at, self.position + u * offset.x + v * offset.y)
        });
        lit.count() as f64 / f64::from(rays)
    }

    /// The share of the lamp that a sphere leaves visible from `at`.
    ///
    /// The lamp's disc, seen from `at` in the plane of the sphere, overlaps the sphere's disc; the overlap is taken as a
    /// smooth step between touching from outside and lying within, which keeps it continuous in every argument.
    pub(crate) fn past_sphere(&self, at: DVec3, centre: DVec3, radius: f64) -> f64 {
        let to_lamp = self.position - at;
        let share = (centre - at).dot(to_lamp) / to_lamp.length_squared();
        if share <= 0.0 || share >= 1.0 {
            return 1.0;
        }
        let miss = (at + to_lamp * share - centre).length();
        let penumbra = self.radius * share;
        let (outer, inner) = (radius + penumbra, (radius - penumbra).abs());
        if miss >= outer {
            return 1.0;
        }
        let u = ((outer - miss) / (outer - inner)).clamp(0.0, 1.0);
        let covered = (radius / penumbra).powi(2).min(1.0);
        1.0 - covered * u * u * (3.0 - 2.0 * u)
    }

    /// Distance from the segment `at`-lamp to `centre`, metres: a sphere farther than its radius plus
    /// [`Light::radius`] casts no shadow on `at`.
    pub(crate) fn clearance(&self, at: DVec3, centre: DVec3) -> f64 {
        let to_lamp = self.position - at;
        let share = ((centre - at).dot(to_lamp) / to_lamp.length_squared()).clamp(0.0, 1.0);
        (at + to_lamp * share - centre).length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_shadows_exactly_what_lies_behind_it() {
        let light = Light::default();
        let centre = DVec3::new(-0.3, -1.0, -0.4);
        let beyond = light.position + (centre - light.position) * 1.5;
        assert!(light.past_sphere(beyond, centre, 0.13) < 0.1, "right behind the sphere");
        assert_eq!(light.past_sphere(beyond + DVec3::X, centre, 0.13), 1.0, "far aside");
        let before = light.position + (centre - light.position) * 0.5;
        assert_eq!(light.past_sphere(before, centre, 0.13), 1.0, "between lamp and sphere");
        for step in 0..200 {
            let at = beyond + DVec3::X * 0.005 * f64::from(step);
            if light.clearance(at, centre) > 0.13 + light.radius {
                assert_eq!(light.past_sphere(at, centre, 0.13), 1.0);
            }
        }
    }
}
