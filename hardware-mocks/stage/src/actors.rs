//! What moves as a ray sees it: which parts it meets, in which order, and in what light.

use std::ops::{BitAnd, BitOrAssign};

use glam::DVec3;

use super::{
    Stage,
    form::{Ray, Touch},
    paint::albedo,
    path::Place,
};

/// A set of the cast's parts and of their shadows: a bit for each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Actors {
    parts: u128,
    shadows: u128,
}

impl Actors {
    pub const NONE: Self = Self { parts: 0, shadows: 0 };
    pub const SHADOWS: Self = Self { parts: 0, shadows: u128::MAX };
    pub const ALL: Self = Self { parts: u128::MAX, shadows: u128::MAX };
    pub fn part(number: usize) -> Self {
        Self { parts: 1 << number, shadows: 0 }
    }

    pub fn shadow(number: usize) -> Self {
        Self { parts: 0, shadows: 1 << number }
    }

    #[cfg(test)]
    pub fn without(self, others: Self) -> Self {
        Self { parts: self.parts & !others.parts, shadows: self.shadows & !others.shadows }
    }

    pub fn has(self, any: Self) -> bool {
        self & any != Self::NONE
    }
}

impl BitAnd for Actors {
    type Output = Self;
    fn bitand(self, other: Self) -> Self {
        Self { parts: self.parts & other.parts, shadows: self.shadows & other.shadows }
    }
}

impl BitOrAssign for Actors {
    fn bitor_assign(&mut self, other: Self) {
        self.parts |= other.parts;
        self.shadows |= other.shadows;
    }
}

/// Where the parts are at one time: those asked for alone, and none in an empty room.
#[derive(Clone, Debug)]
pub(crate) struct Moment {
    pub actors: Actors,
    /// Parts by their number in the cast, in that order.
    pub places: Vec<(usize, Place)>,
    /// The lamp's light as a share of its mean.
    pub lamp: f64,
}

impl Moment {
    pub(crate) fn at(stage: &Stage, t: f64, actors: Actors) -> Self {
        let actors = if stage.options.empty { Actors::NONE } else { actors };
        let asked = |number: usize| actors.has(Actors::part(number)) || actors.has(Actors::shadow(number));
        let parts = stage.cast.parts.iter().enumerate().filter(|(number, _)| asked(*number));
        let places = parts.map(|(number, part)| (number, part.path.place(t))).collect();
        Self { actors, places, lamp: stage.lamp(t) }
    }
}

/// The part of a ray that one part of the cast covers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Which part.
    pub part: usize,
    /// Distance along the ray, metres.
    pub distance: f64,
    /// Share of the ray covered, in (0, 1].
    pub cover: f64,
    /// Linear light towards the camera.
    pub colour: DVec3,
}

/// Fragments of a ray, nearest first.
#[derive(Default)]
pub(crate) struct Fragments(Vec<Fragment>);

impl Fragments {
    fn insert(&mut self, fragment: Fragment) {
        let index = self.0.partition_point(|known| known.distance <= fragment.distance);
        self.0.insert(index, fragment);
    }

    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = &Fragment> {
        self.0.iter()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl Stage {
    /// Those of `actors` that come within `margin` (radians) of a ray, at least: by their bounding spheres. Shadows stay.
    pub(crate) fn within(&self, ray: &Ray, margin: f64, moment: &Moment, actors: Actors) -> Actors {
        let actors = actors & moment.actors;
        let mut near = if self.casts_shadows() { actors & Actors::SHADOWS } else { Actors::NONE };
        for (number, place) in &moment.places {
            let part = &self.cast.parts[*number];
            if actors.has(Actors::part(*number)) && part.form.near(ray, margin, place, &part.spheres) {
                near |= Actors::part(*number);
            }
        }
        near
    }

    /// What of `actors` (all of which the moment must know) a ray sees nearer than `limit` metres.
    pub(crate) fn fragments(&self, ray: &Ray, moment: &Moment, actors: Actors, limit: f64) -> Fragments {
        let mut found = Fragments::default();
        for (number, place) in &moment.places {
            if !actors.has(Actors::part(*number)) {
                continue;
            }
            if let Some(touch) = self.cast.parts[*number].form.touch(ray, limit, place) {
                let colour = self.lit(*number, ray, &touch, moment.lamp);
                found.insert(Fragment { part: *number, distance: touch.distance, cover: touch.cover, colour });
            }
        }
        found
    }

    fn lit(&self, number: usize, ray: &Ray, touch: &Touch, lamp: f64) -> DVec3 {
        let part = &self.cast.parts[number];
        let albedo = albedo(part.paint, self.set.seed, touch.surface, touch.footprint);
        let dull = albedo * (self.light.ambient(touch.normal) + self.light.direct(touch.at, touch.normal) * lamp);
        match part.gloss {
            0.0 => dull,
            gloss => dull + self.light.mirrored(touch.at, touch.normal, ray.direction) * (gloss * lamp),
        }
    }
}
