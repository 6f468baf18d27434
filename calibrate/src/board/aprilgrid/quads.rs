//! Four corners that edges join.

use std::collections::BTreeSet;

use glam::DVec2;

use super::Saddle;

/// Sine of the angle by which an edge may miss the next corner, and by which the directions at its two ends may differ: lenses
/// bend edges, and small tags blur them.
const SLACK: f64 = 0.22;
/// Corners along each edge's direction that are tried.
const NEAREST: usize = 3;
/// Shorter edges leave less than a pixel to each cell of a tag.
const SHORTEST_PX: f64 = 8.0;

/// All quadrilaterals whose sides follow the edges at their corners; clockwise as seen.
pub(super) fn quads(saddles: &[Saddle]) -> Vec<[usize; 4]> {
    let joined = joined(saddles);
    let mut found = Vec::new();
    for (a, near) in joined.iter().enumerate() {
        // Each is found once, from its lowest corner.
        for (&b, &d) in near.range(a + 1..).flat_map(|b| near.range(b + 1..).map(move |d| (b, d))) {
            for &c in joined[b].intersection(&joined[d]).filter(|&&c| c > a) {
                match turn([a, b, c, d].map(|index| saddles[index].at)) {
                    Some(true) => found.push([a, b, c, d]),
                    Some(false) => found.push([a, d, c, b]),
                    None => {}
                }
            }
        }
    }
    found
}

/// For each corner those that may be at the other ends of its edges.
fn joined(saddles: &[Saddle]) -> Vec<BTreeSet<usize>> {
    let mut joined = vec![BTreeSet::new(); saddles.len()];
    for (index, saddle) in saddles.iter().enumerate() {
        let mut along: [Vec<(f64, usize)>; 4] = Default::default();
        for (other, end) in saddles.iter().enumerate().filter(|(other, _)| *other != index) {
            let way = end.at - saddle.at;
            let length = way.length();
            if length < SHORTEST_PX {
                continue;
            }
            let way = way / length;
            let follows = |axis: &DVec2| axis.perp_dot(way).abs() < SLACK;
            if !end.axes.iter().any(follows) {
                continue;
            }
            for (axis, direction) in saddle.axes.iter().enumerate() {
                if follows(direction) {
                    along[2 * axis + usize::from(direction.dot(way) < 0.0)].push((length, other));
                }
            }
        }
        for mut candidates in along {
            candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (_, other) in candidates.into_iter().take(NEAREST) {
                joined[index].insert(other);
                joined[other].insert(index);
            }
        }
    }
    joined
}

/// Whether the corners go round clockwise as seen; `None` where they make no convex figure whose sides are of like length.
fn turn(corners: [DVec2; 4]) -> Option<bool> {
    /// A tag seen so much from the side that a side is this many times another cannot be read.
    const LONGEST: f64 = 6.0;
    let side = |index: usize| corners[(index + 1) % 4] - corners[index];
    let lengths = [0, 1, 2, 3].map(|index| side(index).length());
    let (least, most) = lengths.iter().fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), &l| (a.min(l), b.max(l)));
    // Opposite sides differ by perspective only.
    let alike = |a: f64, b: f64| a.max(b) < 2.0 * a.min(b);
    if most > LONGEST * least || !alike(lengths[0], lengths[2]) || !alike(lengths[1], lengths[3]) {
        return None;
    }
    let sines = [0, 1, 2, 3].map(|index| {
        let (before, after) = (side((index + 3) % 4), side(index));
        before.perp_dot(after) / (before.length() * after.length())
    });
    if sines.iter().all(|sine| *sine > 0.15) {
        Some(true)
    } else if sines.iter().all(|sine| *sine < -0.15) {
        Some(false)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_of_a_square_make_one_quadrilateral_clockwise_and_edges_that_lead_elsewhere_none() {
        let saddle = |x: f64, y: f64, angle: f64| Saddle {
            at: DVec2::new(x, y),
            axes: [DVec2::from_angle(angle), DVec2::from_angle(angle + std::f64::consts::FRAC_PI_2)],
        };
        let places = [(10.0, 10.0), (50.0, 50.0), (50.0, 10.0), (10.0, 50.0)];
        let square: Vec<Saddle> = places.iter().map(|&(x, y)| saddle(x, y, 0.0)).collect();
        let found = quads(&square);
        assert_eq!(found, [[0, 2, 1, 3]]);
        let turned: Vec<Saddle> = places.iter().map(|&(x, y)| saddle(x, y, 0.7)).collect();
        assert!(quads(&turned).is_empty());
    }
}
