//! Which pixels the moving objects can reach during a time: a superset, found from bounding spheres.

use glam::DVec3;
use rayon::prelude::*;

use super::{
    actors::{Actors, Moment},
    view::StageView,
};

/// A sphere that holds a piece of an actor (or what casts its shadow) during an interval of time.
#[derive(Clone, Copy, Debug)]
struct Bound {
    actor: Actors,
    centre: DVec3,
    radius: f64,
    /// No point of the actor moves faster than this, metres per second.
    speed: f64,
}

impl StageView<'_> {
    /// The pixels that something can touch during `[from, to]` seconds, in order, and what can touch each.
    pub(crate) fn reached(&self, from: f64, to: f64) -> Vec<(usize, Actors)> {
        let mut reached = vec![Actors::NONE; self.pixels()];
        for bound in self.bounds(0.5 * (from + to), 0.5 * (to - from)) {
            if bound.actor.has(Actors::SHADOWS) {
                self.mark_shadow(&bound, &mut reached);
            } else {
                self.mark_object(&bound, &mut reached);
            }
        }
        reached.into_iter().enumerate().filter(|(_, actors)| *actors != Actors::NONE).collect()
    }

    /// A bound on how fast anything moves across the image within `half` seconds about `t`, pixels per second.
    pub(crate) fn pixel_speed(&self, t: f64, half: f64) -> f64 {
        let speeds = self.bounds(t, half).into_iter().map(|bound| self.bound_pixel_speed(&bound));
        speeds.fold(0.0, f64::max)
    }

    /// The same for each kind of actor that is in `actors`.
    pub(crate) fn pixel_speeds(&self, t: f64, half: f64) -> Vec<(Actors, f64)> {
        self.bounds(t, half).into_iter().map(|bound| (bound.actor, self.bound_pixel_speed(&bound))).collect()
    }

    fn bound_pixel_speed(&self, bound: &Bound) -> f64 {
        let focal = self.intrinsics.fx.max(self.intrinsics.fy);
        let shadow = bound.actor.has(Actors::SHADOWS);
        let gap = if shadow { 1.0 } else { (self.eye - bound.centre).length() - bound.radius };
        bound.speed * focal / gap.max(0.3)
    }

    fn bounds(&self, t: f64, half: f64) -> Vec<Bound> {
        let stage = self.stage;
        let moment = Moment::at(stage, t, Actors::ALL);
        let mut bounds = Vec::new();
        for (number, place) in &moment.places {
            let part = &stage.cast.parts[*number];
            let speed = part.path.speed(t, half);
            let fastest = speed.origin + speed.turn * part.form.reach() + part.form.bends();
            for &(centre, radius) in &part.spheres {
                // What is about its frame's origin is not carried by a turn.
                let margin =
                    if centre == DVec3::ZERO && part.form.bends() == 0.0 { speed.origin } else { fastest } * half;
                let (actor, centre) = (Actors::part(*number), place.world(centre));
                bounds.push(Bound { actor, centre, radius: radius + margin, speed: fastest });
            }
            if let Some(shade) = part.shade.filter(|_| stage.casts_shadows()) {
                let radius = shade + stage.light.radius + speed.origin * half;
                let speed = 2.0 * speed.origin;
                bounds.push(Bound { actor: Actors::shadow(*number), centre: place.origin, radius, speed });
            }
        }
        bounds
    }

    fn mark_object(&self, bound: &Bound, reached: &mut [Actors]) {
        let intrinsics = &self.intrinsics;
        let (width, height) = (intrinsics.width as usize, intrinsics.height as usize);
        let focal = intrinsics.fx.min(intrinsics.fy);
        let centre = self.pose.transform(bound.centre);
        // A pixel and a half covers the pixel's own corner and the width of its sub-pixels' cones.
        let radius = bound.radius + 1.5 * (centre.length() + bound.radius) / focal;
        if centre.z <= -radius {
            return;
        }
        let range = |c: f64, f: f64, principal: f64, size: usize| {
            if centre.z <= radius * 1.05 {
                return 0..size;
            }
            let edge = |value: f64| value / if value < 0.0 { centre.z - radius } else { centre.z + radius };
            let low = f * edge(c - radius) + principal - 1.0;
            let high = f * -edge(-(c + radius)) + principal + 1.0;
            (low.max(0.0) as usize)..(high.clamp(0.0, size as f64) as usize)
        };
        let columns = range(centre.x, intrinsics.fx, intrinsics.cx, width);
        let rows = range(centre.y, intrinsics.fy, intrinsics.cy, height);
        for row in rows {
            for column in columns.clone() {
                let x = (column as f64 + 0.5 - intrinsics.cx) / intrinsics.fx;
                let y = (row as f64 + 0.5 - intrinsics.cy) / intrinsics.fy;
                let direction = DVec3::new(x, y, 1.0);
                let along = centre.dot(direction) / direction.length_squared();
                if (centre - direction * along.max(0.0)).length_squared() <= radius * radius {
                    reached[row * width + column] |= bound.actor;
                }
            }
        }
    }

    fn mark_shadow(&self, bound: &Bound, reached: &mut [Actors]) {
        let light = &self.stage.light;
        reached.par_iter_mut().zip(&self.patches).with_min_len(4096).for_each(|(actors, patch)| {
            if light.clearance(patch.centre, bound.centre) <= bound.radius + patch.radius {
                *actors |= bound.actor;
            }
        });
    }
}
