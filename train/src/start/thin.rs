//! How many Gaussians the surface of a body starts with.
//!
//! Surfaces are carved as finely as silhouettes of all instants allow. Where a cell is less than a pixel wide, a Gaussian for each costs
//! time and says nothing: density control adds those that a texture needs.

use std::collections::HashMap;

use erfgs_dataset::Body;
use glam::{DVec3, IVec3};

/// A body keeps so many points, where it has them.
const FEWEST: usize = 48;
/// What is thinned too much is thinned again with so much of the distance.
const SHORTER: f64 = 0.9;

/// `body` with no point of its surface nearer than `apart_m` to another, unless too few would be left of it.
pub fn thin(mut body: Body, apart_m: f64) -> Body {
    let mut apart_m = apart_m;
    let kept = loop {
        let kept = spread(&body, apart_m);
        if kept.len() >= FEWEST.min(body.points.len()) {
            break kept;
        }
        apart_m *= SHORTER;
    };
    body.points = kept.into_iter().map(|index| body.points[index]).collect();
    body
}

/// The points, in their order, that are no nearer than `apart_m` to one before them.
fn spread(body: &Body, apart_m: f64) -> Vec<usize> {
    if !(apart_m.is_normal() && apart_m > 0.0) {
        return (0..body.points.len()).collect();
    }
    let mut kept = Vec::new();
    let mut cells: HashMap<IVec3, Vec<DVec3>> = HashMap::new();
    for (index, point) in body.points.iter().enumerate() {
        let place = DVec3::from(point.position_m);
        let cell = (place / apart_m).floor().as_ivec3();
        let around = (0..27).map(|n| cell.saturating_add(IVec3::new(n % 3, n / 3 % 3, n / 9) - 1));
        let taken =
            |at: IVec3| cells.get(&at).is_some_and(|there| there.iter().any(|other| other.distance(place) < apart_m));
        if !around.into_iter().any(taken) {
            cells.entry(cell).or_default().push(place);
            kept.push(index);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use erfgs_dataset::SurfacePoint;

    use super::*;

    /// A plate of `side` by `side` points, 1 cm apart.
    fn plate(side: u32) -> Body {
        let point = |n: u32| SurfacePoint {
            position_m: [0.01 * f64::from(n % side), 0.01 * f64::from(n / side), 0.0],
            normal: [0.0, 0.0, 1.0],
            colour: [n as u8, 0, 0],
        };
        let points = (0..side * side).map(point).collect();
        Body { name: "plate".into(), span_ns: [0, 1], poses: Vec::new(), points, found_by: Default::default() }
    }

    fn nearest(body: &Body) -> f64 {
        let places: Vec<DVec3> = body.points.iter().map(|point| DVec3::from(point.position_m)).collect();
        let from = |index: usize| {
            let others = places.iter().enumerate().filter(move |(other, _)| *other != index);
            others.map(|(_, other)| other.distance(places[index])).fold(f64::INFINITY, f64::min)
        };
        (0..places.len()).map(from).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn points_are_as_far_apart_as_is_asked_for_and_leave_no_hole() {
        let all = plate(40);
        let thinned = thin(all.clone(), 0.025);
        assert!(nearest(&thinned) >= 0.025 && (150..=320).contains(&thinned.points.len()), "{}", thinned.points.len());
        for point in &all.points {
            let place = DVec3::from(point.position_m);
            assert!(thinned.points.iter().any(|kept| DVec3::from(kept.position_m).distance(place) < 0.025));
        }
        assert!(thinned.points.iter().all(|point| all.points.contains(point)));
    }

    #[test]
    fn what_is_small_keeps_points_enough() {
        assert!((FEWEST..200).contains(&thin(plate(20), 0.5).points.len()));
        assert_eq!(thin(plate(5), 0.5).points.len(), 25);
        for odd in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
            assert!(thin(plate(10), odd).points.len() >= FEWEST, "{odd}");
        }
        assert!(thin(plate(0), 0.1).points.is_empty());
    }
}
