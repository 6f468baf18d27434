//! The shapes of what moves, as a ray sees them.
//!
//! A ray stands for a cone one sub-pixel wide: it covers a shape by a share that changes continuously as the shape moves,
//! never by a yes or no. That keeps each pixel's intensity a continuous function of time.

mod ball;
mod blade;
mod block;
mod capsule;
mod disc;
mod flag;
mod rod;
mod sample;
mod soft;

pub(crate) use flag::{Flag, Wave};

use glam::DVec3;

use super::path::{Place, SoftBall};

/// A ray that stands for a cone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// Width of the cone at 1 m, metres.
    pub spread: f64,
}

impl Ray {
    pub(crate) fn at(&self, distance: f64) -> DVec3 {
        self.origin + self.direction * distance
    }
}

/// Where a ray touches a shape.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touch {
    /// Distance along the ray, metres.
    pub distance: f64,
    /// Share of the ray covered, in (0, 1].
    pub cover: f64,
    /// The place that is lit, metres.
    pub at: DVec3,
    /// Unit normal on the ray's side.
    pub normal: DVec3,
    /// Coordinates for the paint: in the shape's frame, metres (balls: the unit vector from the centre).
    pub surface: DVec3,
    /// The width to average the paint over, in the unit of `surface`.
    pub footprint: f64,
}

/// A place on a shape's surface, in its frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub position: DVec3,
    pub normal: DVec3,
    /// Coordinates for the paint.
    pub surface: DVec3,
}

/// The shapes there are. Lengths are metres, in a frame of the shape's own.
#[derive(Clone, Debug)]
pub(crate) enum Form {
    /// About the origin.
    Ball { radius: f64 },
    /// A leaf without thickness along x from `span[0]` to `span[1]`, `width` along y.
    Blade { span: [f64; 2], width: f64 },
    /// A rod along y, from 0 to `length`.
    Rod { length: f64, radius: f64 },
    /// A box about the origin.
    Block { half: DVec3 },
    /// A rod with round ends along y, from `-half` to `half`.
    Capsule { half: f64, radius: f64 },
    /// A disc without thickness about the origin, across z.
    Disc { radius: f64 },
    /// A ball that its path presses flat.
    Soft(SoftBall),
    /// A patch of cloth, x from the pole and y down.
    Flag(Flag),
}

/// A rod is bounded by this many spheres.
const ROD_SPHERES: u32 = 6;

impl Form {
    /// Where a ray touches it nearer than `limit` metres.
    pub(crate) fn touch(&self, ray: &Ray, limit: f64, place: &Place) -> Option<Touch> {
        match *self {
            Self::Soft(ref ball) => soft::touch(ray, limit, place, ball.axes(place.t)),
            Self::Flag(ref flag) => flag::touch(ray, limit, place, flag),
            Self::Ball { radius } => ball::touch(ray, limit, place, radius),
            Self::Blade { span, width } => blade::touch(ray, limit, place, span, width),
            Self::Rod { length, radius } => rod::touch(ray, limit, place, length, radius),
            Self::Block { half } => block::touch(ray, limit, place, half),
            Self::Capsule { half, radius } => capsule::touch(ray, limit, place, half, radius),
            Self::Disc { radius } => disc::touch(ray, limit, place, radius),
        }
    }

    /// Spheres that hold it, together.
    pub(crate) fn spheres(&self) -> Vec<(DVec3, f64)> {
        match *self {
            Self::Ball { radius } | Self::Disc { radius } => vec![(DVec3::ZERO, radius)],
            Self::Blade { span: [root, tip], width } => {
                vec![(DVec3::X * (0.5 * (root + tip)), (0.5 * (tip - root)).hypot(0.5 * width))]
            }
            Self::Rod { length, radius } => {
                let piece = length / f64::from(ROD_SPHERES);
                let middle = |index| DVec3::Y * (piece * (f64::from(index) + 0.5));
                (0..ROD_SPHERES).map(|index| (middle(index), 0.5 * piece + radius)).collect()
            }
            Self::Block { half } => vec![(DVec3::ZERO, half.length())],
            Self::Capsule { half, radius } => vec![(DVec3::ZERO, half + radius)],
            Self::Soft(ref ball) => vec![(DVec3::ZERO, ball.reach())],
            Self::Flag(ref flag) => flag.spheres(),
        }
    }

    /// No point of it is farther from its frame's origin, metres.
    pub(crate) fn reach(&self) -> f64 {
        match *self {
            Self::Ball { radius } | Self::Disc { radius } => radius,
            Self::Blade { span, width } => span[1].hypot(0.5 * width),
            Self::Rod { length, radius } => length + radius,
            Self::Block { half } => half.length(),
            Self::Capsule { half, radius } => half + radius,
            Self::Soft(ref ball) => ball.reach(),
            Self::Flag(ref flag) => flag.size[0].hypot(flag.size[1]) + flag.most(),
        }
    }

    /// Where a place of its surface is in the world.
    pub(crate) fn carried(&self, sample: &Sample, place: &Place) -> DVec3 {
        match self {
            Self::Soft(ball) => place.origin + (place.axes * sample.normal) * ball.axes(place.t),
            Self::Flag(flag) => {
                let at = sample.position;
                place.world(at.with_z(flag.lift(at.x, at.y, place.t)[0]))
            }
            _ => place.world(sample.position),
        }
    }

    /// No point of it moves faster than this in its frame, metres per second.
    pub(crate) fn bends(&self) -> f64 {
        match self {
            Self::Soft(ball) => ball.bends(),
            Self::Flag(flag) => flag.bends(),
            _ => 0.0,
        }
    }

    /// Whether it may come within `margin` (radians) of a ray.
    pub(crate) fn near(&self, ray: &Ray, margin: f64, place: &Place, spheres: &[(DVec3, f64)]) -> bool {
        match *self {
            Self::Rod { length, radius } => rod::near(ray, margin, place, length, radius),
            _ => spheres.iter().any(|&(centre, radius)| near_sphere(ray, margin, place.world(centre), radius)),
        }
    }
}

/// Whether a sphere comes within `margin` (radians) of a ray.
fn near_sphere(ray: &Ray, margin: f64, centre: DVec3, radius: f64) -> bool {
    let offset = centre - ray.origin;
    let along = offset.dot(ray.direction);
    let reach = radius + margin * (along.abs() + radius);
    along > -reach && offset.length_squared() - along * along <= reach * reach
}
