//! Merging points of several instants, and limiting how many there are.

use std::collections::{HashMap, HashSet};

use glam::{DVec3, I64Vec3};

use super::CloudPoint;

/// The cell of a grid of side `size` that a point lies in.
fn cell(point: DVec3, size: f64) -> I64Vec3 {
    (point / size).floor().as_i64vec3()
}

/// Makes one point of points that were found at different instants within `radius` metres: what stands still is found
/// again at each. The point with the longest track stays; of equal ones, that with the smallest error.
///
/// Points of one instant are never merged. The result is ordered by instant.
pub fn merge_instants(mut points: Vec<CloudPoint>, radius: f64) -> Vec<CloudPoint> {
    if radius.is_nan() || radius <= 0.0 {
        return points;
    }
    points.sort_by(|a, b| {
        b.track
            .cmp(&a.track)
            .then(a.reprojection_error_px.total_cmp(&b.reprojection_error_px))
            .then(a.t_ns.cmp(&b.t_ns))
            .then_with(|| order(a.position, b.position))
    });
    let mut kept: Vec<CloudPoint> = Vec::with_capacity(points.len());
    let mut times: Vec<HashSet<i64>> = Vec::with_capacity(points.len());
    let mut grid: HashMap<I64Vec3, Vec<usize>> = HashMap::new();
    for point in points {
        let home = cell(point.position, radius);
        let near = (0..27).flat_map(|index| {
            let offset = I64Vec3::new(index % 3 - 1, index / 3 % 3 - 1, index / 9 - 1);
            grid.get(&(home + offset)).into_iter().flatten().copied()
        });
        let same = near
            .filter(|&index| !times[index].contains(&point.t_ns))
            .map(|index| (index, kept[index].position.distance_squared(point.position)))
            .filter(|&(_, distance)| distance <= radius * radius)
            .min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        match same {
            Some((index, _)) => {
                times[index].insert(point.t_ns);
                let other = &mut kept[index];
                other.t_ns = other.t_ns.min(point.t_ns);
                other.instants = times[index].len() as u32;
            }
            None => {
                grid.entry(home).or_default().push(kept.len());
                times.push(HashSet::from([point.t_ns]));
                kept.push(point);
            }
        }
    }
    kept.sort_by(|a, b| a.t_ns.cmp(&b.t_ns).then_with(|| order(a.position, b.position)));
    kept
}

fn order(a: DVec3, b: DVec3) -> std::cmp::Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
}

/// Thins `points` to at most `most`, one for each cell of the finest grid that does it. Points that come earlier in the
/// list stay; the first `first` of them are thinned only if they alone are too many.
pub fn limit(mut points: Vec<CloudPoint>, first: usize, most: usize) -> Vec<CloudPoint> {
    if points.len() <= most {
        return points;
    }
    let first = if first > most {
        points.truncate(first);
        0
    } else {
        first
    };
    let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| {
        (low.min(point.position), high.max(point.position))
    });
    let extent = (high - low).max_element().max(1e-6);
    // Coarse grids keep too few, fine ones too many; the count is nearly monotonic in between.
    let (mut fine, mut coarse) = (1e-6 * extent, 2.0 * extent);
    let mut best = occupied(&points, first, coarse);
    for _ in 0..40 {
        let size = (fine * coarse).sqrt();
        let kept = occupied(&points, first, size);
        if kept.len() <= most {
            coarse = size;
            if kept.len() >= best.len() {
                best = kept;
            }
        } else {
            fine = size;
        }
        if coarse / fine < 1.0001 {
            break;
        }
    }
    best.truncate(most);
    best.into_iter().map(|index| points[index]).collect()
}

/// Indices of the first `first` points, and of those others that are the first in their cell.
fn occupied(points: &[CloudPoint], first: usize, size: f64) -> Vec<usize> {
    let mut cells = HashSet::with_capacity(points.len());
    let mut kept = Vec::new();
    for (index, point) in points.iter().enumerate() {
        if cells.insert(cell(point.position, size)) || index < first {
            kept.push(index);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, t_ns: i64, track: u32) -> CloudPoint {
        CloudPoint {
            position: DVec3::new(x, 0.0, 0.0),
            colour: [0; 3],
            track,
            reprojection_error_px: 0.5,
            t_ns,
            instants: 1,
            moving: false,
        }
    }

    #[test]
    fn a_static_point_seen_at_three_instants_becomes_one_and_knows_it() {
        let merged = merge_instants(vec![point(1.0, 20, 3), point(1.004, 0, 5), point(0.997, 40, 4)], 0.01);
        assert_eq!(merged.len(), 1);
        assert_eq!((merged[0].instants, merged[0].t_ns, merged[0].track), (3, 0, 5));
        assert_eq!(merged[0].position.x, 1.004, "the longest track stays");
    }

    #[test]
    fn points_of_one_instant_and_points_apart_stay_apart() {
        let points = vec![point(1.0, 0, 3), point(1.001, 0, 3), point(2.0, 20, 3)];
        let merged = merge_instants(points.clone(), 0.01);
        assert_eq!(merged.len(), 3);
        assert!(merged.iter().all(|point| point.instants == 1));
        assert_eq!(merge_instants(points.clone(), 0.0), points, "no radius, no merging");
    }

    #[test]
    fn merging_does_not_depend_on_the_order() {
        let mut points: Vec<_> =
            (0..200_u32).map(|i| point(f64::from(i * 37 % 101) * 0.003, i64::from(i % 3), 3 + i % 4)).collect();
        let forward = merge_instants(points.clone(), 0.01);
        points.reverse();
        assert_eq!(merge_instants(points, 0.01), forward);
    }

    #[test]
    fn thinning_reaches_the_limit_and_keeps_the_first() {
        let points: Vec<_> = (0..10_000).map(|i| point(f64::from(i) * 0.001, 0, 3)).collect();
        let thin = limit(points.clone(), 10, 1000);
        assert!((900..=1000).contains(&thin.len()), "{}", thin.len());
        assert_eq!(thin[..10], points[..10]);
        assert_eq!(limit(points.clone(), 0, 20_000), points);
        let few = limit(points, 5000, 100);
        assert!((80..=100).contains(&few.len()), "{}", few.len());
    }

    #[test]
    fn thinning_copes_with_points_at_one_place() {
        assert_eq!(limit(vec![point(1.0, 0, 3); 50], 0, 10).len(), 1);
        assert_eq!(limit(vec![point(1.0, 0, 3); 50], 10, 10).len(), 10);
        assert_eq!(limit(vec![point(1.0, 0, 3); 50], 10, 0).len(), 0);
    }
}
