//! Rotation by frames: the colours of a thing's points at one instant against the frames of the next, turned by a hypothesis.

use erfgs_base::random;
use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::{
    film::{Film, MOST_APART},
    normals::normals,
};

/// Points of one pair of instants that are compared, at most.
const MOST_POINTS: usize = 80;
/// With fewer points at an instant a thing is not compared there, and with fewer pairs not at all.
const FEWEST_POINTS: usize = 25;
const FEWEST_PAIRS: usize = 4;

/// A point of an instant about its centre.
#[derive(Clone, Copy, Debug)]
struct Shade {
    place: DVec3,
    normal: DVec3,
    colour: [u8; 3],
}

/// Points of one instant and what they are compared with.
#[derive(Clone, Debug)]
struct Pair {
    shades: Vec<Shade>,
    /// Where the centre is at the other instant.
    centre: DVec3,
    /// From the one to the other, seconds.
    seconds: f64,
    /// Which instants they are.
    from: usize,
    to: usize,
}

/// Colours of a thing at several instants.
pub trait Compared: Sync {
    /// How far they are apart if the thing turns at each of `rates` (radians per second about axes), 0 for the same.
    fn apart(&self, rates: &[DVec3]) -> Vec<f64>;
}

/// The pairs of instants of a thing.
#[derive(Debug)]
pub struct Shades<'a> {
    film: &'a Film,
    pairs: Vec<Pair>,
}

/// A thing's points at an instant: of which instant, their places about its centre, their colours, and the centre.
pub struct Shape {
    /// Index of the instant.
    pub moment: usize,
    /// Where the centre is, metres.
    pub centre: DVec3,
    /// Places about the centre, metres.
    pub places: Vec<DVec3>,
    /// Outwards, of length 1.
    pub normals: Vec<DVec3>,
    /// Colours, sRGB.
    pub colours: Vec<[u8; 3]>,
}

impl Shape {
    /// Of places in the world.
    pub fn new(moment: usize, centre: DVec3, points: impl IntoIterator<Item = (DVec3, [u8; 3])>) -> Self {
        let (places, colours): (Vec<DVec3>, Vec<[u8; 3]>) =
            points.into_iter().map(|(point, colour)| (point - centre, colour)).unzip();
        Self { moment, centre, normals: normals(&places), places, colours }
    }
}

const PURPOSE: u64 = random::purpose("bodies: points whose colours are compared");

impl<'a> Shades<'a> {
    /// Of a thing's shapes, ordered by time; none where it is seen too seldom or has too few points.
    pub fn new(film: &'a Film, shapes: &[Shape]) -> Option<Self> {
        let mut pairs = Vec::new();
        for both in shapes.windows(2) {
            if both.iter().any(|shape| shape.places.len() < FEWEST_POINTS) {
                continue;
            }
            for (from, to) in [(&both[0], &both[1]), (&both[1], &both[0])] {
                let key = random::key(0, &[PURPOSE, from.moment as u64, to.moment as u64]);
                let shade =
                    |at: usize| Shade { place: from.places[at], normal: from.normals[at], colour: from.colours[at] };
                let order = random::permutation(key, from.places.len());
                let shades = order.into_iter().take(MOST_POINTS).map(shade).collect();
                let seconds = film.moments[to.moment].t_s - film.moments[from.moment].t_s;
                pairs.push(Pair { shades, centre: to.centre, seconds, from: from.moment, to: to.moment });
            }
        }
        (pairs.len() >= FEWEST_PAIRS).then_some(Self { film, pairs })
    }

    /// The same between two instants alone; none where they are not compared.
    pub fn apart_between(&self, instants: [usize; 2], rate: DVec3) -> Option<f64> {
        self.mean(rate, self.pairs.iter().filter(|pair| instants == [pair.from.min(pair.to), pair.from.max(pair.to)]))
    }

    fn apart_at(&self, rate: DVec3) -> f64 {
        self.mean(rate, &self.pairs).unwrap_or(MOST_APART)
    }

    fn mean<'b>(&self, rate: DVec3, pairs: impl IntoIterator<Item = &'b Pair>) -> Option<f64> {
        let (mut sum, mut weights) = (0.0, 0.0);
        for pair in pairs {
            let turn = DQuat::from_scaled_axis(rate * pair.seconds);
            for shade in &pair.shades {
                let (place, normal) = (turn * shade.place + pair.centre, turn * shade.normal);
                for view in &self.film.moments[pair.to].views {
                    let eye = &self.film.eyes[view.eye];
                    let facing = (eye.centre - place).normalize_or_zero().dot(normal);
                    if facing <= 0.0 {
                        continue;
                    }
                    let Some(pixel) = eye.pixel(place) else { continue };
                    sum += facing * view.apart(pixel, shade.colour);
                    weights += facing;
                }
            }
        }
        (weights > 0.0).then(|| sum / weights)
    }
}

impl Compared for Shades<'_> {
    fn apart(&self, rates: &[DVec3]) -> Vec<f64> {
        rates.par_iter().map(|&rate| self.apart_at(rate)).collect()
    }
}
