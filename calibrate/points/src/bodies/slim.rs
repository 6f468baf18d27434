//! How deep a thing is, where its views leave that open.
//!
//! A silhouette says nothing about depth. From cameras that stand on one side, the hull of a ball of radius 1 reaches 1 / sin a far along
//! a direction, a being the largest angle between that direction and the line to a camera. A thing whose hull is twice as deep as it is
//! seems to turn half as fast, by its events as by its colours. So hulls are made thinner, each point as if it were of a ball.

use glam::DVec3;

use super::{film::Film, normals::normals, shades::Shape};

/// Directions that are so near to all lines of sight tell nothing: the sine of the angle.
const LEAST_SINE: f64 = 0.05;

/// The points of a thing at an instant, as deep as if they were those of a ball.
pub fn slim(film: &Film, shape: &Shape) -> Shape {
    let Shape { moment, centre, .. } = *shape;
    let views = film.moments[moment].views.iter().map(|view| &film.eyes[view.eye]);
    let sights: Vec<DVec3> =
        views.filter(|eye| eye.see(centre).is_some()).map(|eye| (eye.centre - centre).normalize_or_zero()).collect();
    let places: Vec<DVec3> = shape.places.iter().map(|place| *place * reach(&sights, *place)).collect();
    Shape { moment, centre, normals: normals(&places), places, colours: shape.colours.clone() }
}

/// How far a ball reaches in the direction of a place, of how far its hull does, by lines of sight of length 1.
fn reach(sights: &[DVec3], place: DVec3) -> f64 {
    let along = place.normalize_or_zero();
    let sine = sights.iter().map(|sight| sight.cross(along).length()).fold(0.0, f64::max);
    if sights.len() < 2 || sine < LEAST_SINE { 1.0 } else { sine.min(1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{
        carve::{Place, tests::film},
        turn::directions,
    };
    use glam::DQuat;

    /// How far a hull of a ball of radius 1 reaches: until it leaves one of the cylinders behind its silhouettes.
    fn hull(sights: &[DVec3], along: DVec3) -> DVec3 {
        let leaves = |sight: &DVec3| 1.0 / sight.cross(along).length().max(1e-3);
        along * sights.iter().map(leaves).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn the_hull_of_a_ball_becomes_the_ball_from_whichever_sides_it_is_seen() {
        for half_arc in [0.3_f64, 0.8, 1.5] {
            let sight = |k: i32| {
                let angle = half_arc * f64::from(k) / 3.0;
                DVec3::new(angle.sin(), 0.1 * f64::from(k % 2), angle.cos()).normalize()
            };
            let sights: Vec<DVec3> = (-3..=3).map(sight).collect();
            let deepest = hull(&sights, DVec3::Z).z;
            assert!((deepest > 2.0) == (half_arc < 0.5), "{deepest}");
            for along in directions(200) {
                let place = hull(&sights, along);
                assert!((place.length() * reach(&sights, place) - 1.0).abs() < 1e-9, "{along} from {half_arc}");
            }
        }
    }

    #[test]
    fn what_is_seen_from_all_sides_or_by_nobody_stays() {
        let still = Place {
            moment: 0,
            centre: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            exposed: [(DVec3::ZERO, DQuat::IDENTITY); 2],
        };
        let film = film(0.2, &[still]);
        let shape = Shape::new(0, DVec3::ZERO, directions(50).into_iter().map(|along| (0.2 * along, [1; 3])));
        for (before, after) in std::iter::zip(&shape.places, slim(&film, &shape).places) {
            assert!(before.distance(after) < 0.02, "{before} became {after}");
        }
        let far = Shape::new(0, DVec3::splat(1e3), [(DVec3::splat(1e3) + DVec3::X, [1; 3])]);
        assert_eq!(slim(&film, &far).places, [DVec3::X]);
    }
}
