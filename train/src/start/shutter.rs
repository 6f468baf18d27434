//! What an open shutter stretches, shrunk back.
//!
//! Silhouettes of blurred frames enclose all places that a thing had during the exposure, so that a hull of them is longer
//! than the thing by its way. Where the thing was in the middle of the exposure is what stays of the hull when it is moved
//! by half that way, forth and back: its ends come in along the velocity.

use glam::Vec3;
use rayon::prelude::*;

use crate::scene::Point;
use erfgs_splat::gaussians::Neighbours;

/// Points belong to one thing if their colours are no farther apart than this, of 255.
const ALIKE: f32 = 60.0;
/// How wide the tube is in which a thing is followed along its velocity, in distances between points.
const TUBE: f32 = 2.5;
/// How far a thing is followed, in halves of the way.
const FOLLOWED: f32 = 4.0;

/// Where `points` with `velocities` (metres an interval) were in the middle of an exposure of `exposure` intervals.
pub(super) fn shrunk(points: &[Point], velocities: &[[f32; 3]], exposure: f32) -> Vec<Point> {
    let places: Vec<[f32; 3]> = points.iter().map(|(place, _)| *place).collect();
    let around = Neighbours::new(&places);
    let nearest = |place: &[f32; 3]| around.nearest(place, 2).last().map_or(0.0, |(_, squared)| squared.sqrt());
    let spacing = places.par_iter().map(nearest).sum::<f32>() / places.len().max(1) as f32;
    points
        .par_iter()
        .zip(velocities)
        .map(|(point, velocity)| {
            let velocity = Vec3::from(*velocity);
            let half = 0.5 * exposure * velocity.length();
            if !(half > 0.5 * spacing && half.is_finite()) {
                return *point;
            }
            let way = velocity.normalize();
            let shift = inwards(points, point, way, half, TUBE * spacing);
            ((Vec3::from(point.0) + shift * way).to_array(), point.1)
        })
        .collect()
}

/// How far along `way` the place of `point` is from one that stays inside when the thing is moved by `half` to either side.
fn inwards(points: &[Point], point: &Point, way: Vec3, half: f32, tube: f32) -> f32 {
    let colour = |point: &Point| Vec3::from(point.1.map(f32::from));
    // The ends of the thing ahead and behind, as far as they are nearer than `half`.
    let [mut ahead, mut behind] = [0.0_f32; 2];
    let [mut goes_on, mut comes_from] = [false; 2];
    for other in points {
        let offset = Vec3::from(other.0) - Vec3::from(point.0);
        let along = offset.dot(way);
        let aside = (offset.length_squared() - along * along).max(0.0).sqrt();
        if aside > tube || along.abs() > FOLLOWED * half || colour(other).distance(colour(point)) > ALIKE {
            continue;
        }
        if along >= half {
            goes_on = true;
        } else if along <= -half {
            comes_from = true;
        }
        ahead = ahead.max(along.min(half));
        behind = behind.max((-along).min(half));
    }
    match (goes_on, comes_from) {
        (true, true) => 0.0,
        (false, true) => ahead - half,
        (true, false) => half - behind,
        (false, false) => 0.5 * (ahead - behind),
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    /// The surface of a ball of radius `radius` that went by `way` along x, half of it before and half after 0.
    fn stretched(count: u64, radius: f32, way: f32) -> Vec<Point> {
        (0..count)
            .map(|i| {
                let drawn = |k: u64| random::uniform(random::key(3, &[i, k])) as f32;
                let (turn, height) = (std::f32::consts::TAU * drawn(0), 2.0 * drawn(1) - 1.0);
                let ring = (1.0 - height * height).sqrt();
                // Caps at both ends, a cylinder between them.
                let (x, ring) = if drawn(2) < 0.4 {
                    (way * (drawn(3) - 0.5), radius)
                } else {
                    (radius * height + 0.5 * way * height.signum(), radius * ring)
                };
                ([x, ring * turn.cos(), ring * turn.sin()], [200, 30, 30])
            })
            .collect()
    }

    #[test]
    fn a_ball_that_was_stretched_is_round_again() {
        let points = stretched(800, 0.12, 0.4);
        let velocities = vec![[0.8, 0.0, 0.0]; points.len()];
        let longest = |points: &[Point]| points.iter().map(|(place, _)| place[0].abs()).fold(0.0, f32::max);
        assert!(longest(&points) > 0.3);
        let found = shrunk(&points, &velocities, 0.5);
        let outside = found.iter().filter(|(place, _)| Vec3::from(*place).length() > 0.15).count();
        assert!(longest(&found) < 0.17 && outside < 40, "{} and {outside}", longest(&found));
        let mean = found.iter().map(|(place, _)| place[0]).sum::<f32>() / 800.0;
        assert!(mean.abs() < 0.01, "it stays where it was: {mean}");
        assert!(found.iter().zip(&points).all(|(a, b)| a.0[1..] == b.0[1..] && a.1 == b.1), "along the velocity alone");
    }

    #[test]
    fn what_stands_still_or_has_no_exposure_stays() {
        let points = stretched(100, 0.1, 0.3);
        assert_eq!(shrunk(&points, &vec![[0.0; 3]; 100], 0.5), points);
        assert_eq!(shrunk(&points, &vec![[0.8, 0.0, 0.0]; 100], 0.0), points);
        assert_eq!(shrunk(&points, &vec![[f32::INFINITY, 0.0, 0.0]; 100], 0.5), points);
        assert!(shrunk(&[], &[], 0.5).is_empty());
    }
}
