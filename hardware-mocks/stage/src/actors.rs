//! The moving objects as a ray sees them.
//!
//! A ray stands for a cone one sub-pixel wide: it covers an object by a share that changes continuously as the object
//! moves, never by a yes or no. That keeps each pixel's intensity a continuous function of time.

use std::ops::{BitAnd, BitOr, BitOrAssign};

use glam::{DMat3, DVec3};

use super::{
    Stage,
    motion::{BLADES, BladePose, PendulumPose},
    paint::{Paint, albedo},
    texture::{interval, step},
};

/// A set of moving objects and moving shadows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Actors(u16);

impl Actors {
    pub const NONE: Self = Self(0);
    pub const BALL: Self = Self(1);
    pub const BOB: Self = Self(2);
    pub const ROD: Self = Self(4);
    pub const BALL_SHADOW: Self = Self(8);
    pub const BOB_SHADOW: Self = Self(16);
    pub const SHADOWS: Self = Self(8 | 16);
    pub const BLADES: Self = Self(((1 << BLADES) - 1) << 5);
    pub const ALL: Self = Self(31 | Self::BLADES.0);

    /// One blade of the fan.
    pub fn blade(number: usize) -> Self {
        Self(1 << (5 + number))
    }

    #[cfg(test)]
    pub fn without(self, others: Self) -> Self {
        Self(self.0 & !others.0)
    }

    pub fn has(self, any: Self) -> bool {
        self.0 & any.0 != 0
    }
}

impl BitOr for Actors {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitAnd for Actors {
    type Output = Self;
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOrAssign for Actors {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

/// Where the moving objects are at one time: those asked for alone, and none in an empty room.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    pub actors: Actors,
    pub ball: DVec3,
    ball_to_local: DMat3,
    pub blades: [BladePose; BLADES],
    pub pendulum: PendulumPose,
    /// The lamp's light as a share of its mean.
    pub lamp: f64,
}

impl Moment {
    pub(crate) fn at(stage: &Stage, t: f64, actors: Actors) -> Self {
        let actors = if stage.options.empty { Actors::NONE } else { actors };
        let mut moment = Self {
            actors,
            ball: DVec3::ZERO,
            ball_to_local: DMat3::IDENTITY,
            blades: Default::default(),
            pendulum: PendulumPose::default(),
            lamp: stage.lamp(t),
        };
        if actors.has(Actors::BALL | Actors::BALL_SHADOW) {
            moment.ball = stage.ball.centre(t);
            moment.ball_to_local = stage.ball.rotation(t).transpose();
        }
        if actors.has(Actors::BLADES) {
            moment.blades = stage.fan.blades(t);
        }
        if actors.has(Actors::ROD | Actors::BOB | Actors::BOB_SHADOW) {
            moment.pendulum = stage.pendulum.pose(t);
        }
        moment
    }
}

/// A ray that stands for a cone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// Width of the cone at 1 m, metres.
    pub spread: f64,
}

/// The part of a ray that one object covers.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Fragment {
    /// Distance along the ray, metres.
    pub distance: f64,
    /// Share of the ray covered, in (0, 1].
    pub cover: f64,
    /// Linear light towards the camera.
    pub colour: DVec3,
}

/// At most this many fragments on a ray: the ball, the blades, the rod and the bob.
pub(crate) const MOST_FRAGMENTS: usize = 3 + BLADES;

/// Fragments of a ray, nearest first.
#[derive(Default)]
pub(crate) struct Fragments {
    list: [Fragment; MOST_FRAGMENTS],
    count: usize,
}

impl Fragments {
    fn insert(&mut self, fragment: Fragment) {
        let mut index = self.count;
        while index > 0 && self.list[index - 1].distance > fragment.distance {
            self.list[index] = self.list[index - 1];
            index -= 1;
        }
        self.list[index] = fragment;
        self.count += 1;
    }

    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = &Fragment> {
        self.list[..self.count].iter()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.count == 0
    }
}

impl Stage {
    /// Those of `actors` that come within `margin` (radians) of a ray, at least: by their bounding spheres. Shadows stay.
    pub(crate) fn within(&self, ray: &Ray, margin: f64, moment: &Moment, actors: Actors) -> Actors {
        let actors = actors & moment.actors;
        let mut near = if self.options.shadows { actors & Actors::SHADOWS } else { Actors::NONE };
        let mut test = |actor: Actors, centre: DVec3, radius: f64| {
            let offset = centre - ray.origin;
            let along = offset.dot(ray.direction);
            let reach = radius + margin * (along.abs() + radius);
            if along > -reach && offset.length_squared() - along * along <= reach * reach {
                near |= actor;
            }
        };
        if actors.has(Actors::BALL) {
            test(Actors::BALL, moment.ball, self.ball.radius);
        }
        if actors.has(Actors::BOB) {
            test(Actors::BOB, moment.pendulum.bob, self.pendulum.bob_radius);
        }
        if actors.has(Actors::ROD) {
            let half = 0.5 * self.pendulum.length;
            let axis = moment.pendulum.along;
            // The part of the rod nearest to the ray's closest approach, or its end.
            let (side, sine) = ray.direction.cross(axis).normalize_and_length();
            let offset = self.pendulum.pivot - ray.origin;
            let reach = self.pendulum.rod_radius + margin * (offset.length() + 2.0 * half);
            if sine < 0.05 || offset.dot(side).abs() <= reach {
                test(Actors::ROD, self.pendulum.pivot + axis * half, half + self.pendulum.rod_radius);
            }
        }
        for (number, blade) in moment.blades.iter().enumerate() {
            if actors.has(Actors::blade(number)) {
                let (centre, radius) = self.fan.blade_sphere(blade);
                test(Actors::blade(number), centre, radius);
            }
        }
        near
    }

    /// What of `actors` (all of which the moment must know) a ray sees nearer than `limit` metres.
    pub(crate) fn fragments(&self, ray: &Ray, moment: &Moment, actors: Actors, limit: f64) -> Fragments {
        let mut found = Fragments::default();
        if actors.has(Actors::BALL) {
            let ball = (moment.ball, self.ball.radius, &moment.ball_to_local, Paint::Ball);
            self.sphere(ray, limit, ball, moment.lamp, &mut found);
        }
        for (number, blade) in moment.blades.iter().enumerate() {
            if actors.has(Actors::blade(number)) {
                self.blade(ray, limit, (blade, number as u8), moment.lamp, &mut found);
            }
        }
        if actors.has(Actors::ROD) {
            self.rod(ray, limit, moment.pendulum.along, moment.lamp, &mut found);
        }
        if actors.has(Actors::BOB) {
            let to_local = moment.pendulum.rotation.transpose();
            let bob = (moment.pendulum.bob, self.pendulum.bob_radius, &to_local, Paint::Bob);
            self.sphere(ray, limit, bob, moment.lamp, &mut found);
        }
        found
    }

    fn lit(&self, at: DVec3, normal: DVec3, albedo: DVec3, lamp: f64) -> DVec3 {
        albedo * (self.light.ambient(normal) + self.light.direct(at, normal) * lamp)
    }

    fn sphere(
        &self,
        ray: &Ray,
        limit: f64,
        (centre, radius, to_local, paint): (DVec3, f64, &DMat3, Paint),
        lamp: f64,
        found: &mut Fragments,
    ) {
        let offset = centre - ray.origin;
        let along = offset.dot(ray.direction);
        if along <= 0.0 {
            return;
        }
        let miss = (offset.length_squared() - along * along).max(0.0).sqrt();
        let width = along * ray.spread;
        let cover = step(radius - miss, width);
        if cover <= 0.0 {
            return;
        }
        let distance = along - (radius * radius - miss * miss).max(0.0).sqrt();
        if !(distance > 0.0 && distance < limit) {
            return;
        }
        let normal = (ray.origin + ray.direction * distance - centre).normalize();
        let colour = albedo(paint, self.set.seed, *to_local * normal, width / radius);
        found.insert(Fragment { distance, cover, colour: self.lit(centre + normal * radius, normal, colour, lamp) });
    }

    fn blade(&self, ray: &Ray, limit: f64, (blade, number): (&BladePose, u8), lamp: f64, found: &mut Fragments) {
        let facing = ray.direction.dot(blade.normal);
        let offset = self.fan.centre - ray.origin;
        let distance = offset.dot(blade.normal) / facing;
        if !(distance > 0.0 && distance < limit) {
            return;
        }
        let from_hub = ray.direction * distance - offset;
        let (along, across) = (from_hub.dot(blade.along), from_hub.dot(blade.across));
        let [root, tip] = self.fan.blade_span;
        // How far the cone spreads over the blade in either of its directions: the foreshortening of a slanted plane.
        let width = distance * ray.spread;
        let spread = |axis: DVec3| width * 1.0_f64.hypot(ray.direction.dot(axis) / facing);
        let (width_along, width_across) = (spread(blade.along), spread(blade.across));
        let cover = interval(along - 0.5 * (root + tip), 0.5 * (tip - root), width_along)
            * interval(across, self.fan.half_width(along), width_across);
        if cover <= 0.0 {
            return;
        }
        let footprint = width_along.min(width_across).min(0.5);
        let colour = albedo(Paint::Blade(number), self.set.seed, DVec3::new(along, across, 0.0), footprint);
        let normal = if facing > 0.0 { -blade.normal } else { blade.normal };
        let colour = self.lit(ray.origin + ray.direction * distance, normal, colour, lamp);
        found.insert(Fragment { distance, cover, colour });
    }

    fn rod(&self, ray: &Ray, limit: f64, axis: DVec3, lamp: f64, found: &mut Fragments) {
        let radius = self.pendulum.rod_radius;
        let offset = self.pendulum.pivot - ray.origin;
        let (side, sine) = ray.direction.cross(axis).normalize_and_length();
        if sine < 1e-6 {
            return;
        }
        let miss = offset.dot(side);
        // The nearest points of the two lines.
        let (cosine, along_ray, along_rod) = (ray.direction.dot(axis), offset.dot(ray.direction), offset.dot(axis));
        let distance = (along_ray - cosine * along_rod) / (sine * sine);
        let down = (cosine * along_ray - along_rod) / (sine * sine);
        let width = distance * ray.spread;
        if !(width > 0.0 && distance < limit) {
            return;
        }
        let half = 0.5 * self.pendulum.length;
        let cover = interval(miss, radius, width) * interval(down - half, half, width / sine);
        if cover <= 0.0 {
            return;
        }
        let bulge = (miss / radius).clamp(-1.0, 1.0);
        let towards = axis.cross(side);
        let towards = if towards.dot(ray.direction) > 0.0 { -towards } else { towards };
        let normal = (towards * (1.0 - bulge * bulge).sqrt() - side * bulge).normalize();
        let colour = albedo(Paint::Rod, self.set.seed, DVec3::new(0.0, down, 0.0), width / sine);
        let colour = self.lit(ray.origin + ray.direction * distance, normal, colour, lamp);
        found.insert(Fragment { distance, cover, colour });
    }
}
