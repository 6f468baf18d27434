//! Detections: connected pieces of the moving points of an instant.

use std::collections::HashMap;

use glam::{DVec3, IVec3};

/// Points so many spacings apart are of one piece.
const LINK: f64 = 1.8;
/// Pieces with fewer points are no things.
pub const FEWEST: usize = 18;
/// More pieces of one instant are crumbs; the largest are kept.
const MOST: usize = 24;

/// How often a thing has each of 64 colours.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram([f64; 64]);

impl Histogram {
    /// Of colours; smoothed, since shades vary with the light.
    pub fn of<'a>(colours: impl IntoIterator<Item = &'a [u8; 3]>) -> Self {
        let mut bins = [0.0; 64];
        for colour in colours {
            bins[Self::bin(*colour)] += 1.0;
        }
        for stride in [16, 4, 1] {
            let before = bins;
            for (index, bin) in bins.iter_mut().enumerate() {
                let at = index / stride % 4;
                let low = if at > 0 { index - stride } else { index };
                let high = if at < 3 { index + stride } else { index };
                *bin = before[index] * (2.0 / 3.0) + (before[low] + before[high]) / 6.0;
            }
        }
        let total: f64 = bins.iter().sum();
        Self(bins.map(|bin| if total > 0.0 { bin / total } else { 1.0 / 64.0 }))
    }

    /// The mean of several.
    pub fn mean<'a>(of: impl IntoIterator<Item = &'a Self>) -> Self {
        let (mut sum, mut count) = ([0.0; 64], 0.0);
        for histogram in of {
            count += 1.0;
            for (sum, bin) in sum.iter_mut().zip(histogram.0) {
                *sum += bin;
            }
        }
        Self(sum.map(|bin| if count > 0.0 { bin / count } else { 1.0 / 64.0 }))
    }

    fn bin(colour: [u8; 3]) -> usize {
        colour.into_iter().fold(0, |bin, value| 4 * bin + usize::from(value / 64))
    }

    /// How much of one is in the other: 1 of the same, 0 of nothing in common.
    pub fn overlap(&self, other: &Self) -> f64 {
        std::iter::zip(self.0, other.0).map(|(a, b)| a.min(b)).sum()
    }

    /// The logarithm of how much oftener a colour is here than if all were as frequent.
    pub fn speaks_for(&self, colour: [u8; 3]) -> f64 {
        (64.0 * (self.0[Self::bin(colour)] + 0.003)).ln()
    }
}

/// A connected piece.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Indices of its points.
    pub members: Vec<usize>,
    /// The mean of its points, metres.
    pub centre: DVec3,
    /// Their colours.
    pub colours: Histogram,
}

/// The pieces of an instant, largest first.
pub fn detections(points: &[DVec3], colours: &[[u8; 3]], cell_m: f64) -> Vec<Detection> {
    let mut pieces = connected(points, LINK * cell_m);
    pieces.retain(|piece| piece.len() >= FEWEST);
    // A stable sort: of equal ones the first comes first.
    pieces.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    pieces.truncate(MOST);
    pieces.into_iter().map(|members| Detection::new(members, points, colours)).collect()
}

impl Detection {
    /// Of some of the points of an instant.
    pub fn new(members: Vec<usize>, points: &[DVec3], colours: &[[u8; 3]]) -> Self {
        Self {
            centre: mean(members.iter().map(|&member| points[member])),
            colours: Histogram::of(members.iter().map(|&member| &colours[member])),
            members,
        }
    }
}

/// The mean of places; the origin of none.
pub fn mean(places: impl IntoIterator<Item = DVec3>) -> DVec3 {
    let (sum, count) = places.into_iter().fold((DVec3::ZERO, 0.0), |(sum, count), place| (sum + place, count + 1.0));
    if count > 0.0 { sum / count } else { DVec3::ZERO }
}

/// Groups of points that are linked by steps of at most `reach_m`, in the order of their first points.
fn connected(points: &[DVec3], reach_m: f64) -> Vec<Vec<usize>> {
    if reach_m <= 0.0 || reach_m.is_nan() {
        return Vec::new();
    }
    let cell = |point: DVec3| (point / reach_m).floor().as_ivec3();
    let mut cells: HashMap<IVec3, Vec<usize>> = HashMap::new();
    for (index, &point) in points.iter().enumerate() {
        cells.entry(cell(point)).or_default().push(index);
    }
    let (mut group, mut groups) = (vec![usize::MAX; points.len()], Vec::new());
    for first in 0..points.len() {
        if group[first] != usize::MAX {
            continue;
        }
        group[first] = groups.len();
        let (mut members, mut next) = (vec![first], 0);
        while let Some(&at) = members.get(next) {
            next += 1;
            for n in 0..27 {
                let Some(near) = cells.get(&(cell(points[at]) + IVec3::new(n % 3, n / 3 % 3, n / 9) - 1)) else {
                    continue;
                };
                for &other in near {
                    if group[other] == usize::MAX && points[other].distance_squared(points[at]) <= reach_m * reach_m {
                        group[other] = groups.len();
                        members.push(other);
                    }
                }
            }
        }
        members.sort_unstable();
        groups.push(members);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of `side` points along each axis, 1 apart.
    fn cube(side: i32, corner: DVec3) -> impl Iterator<Item = DVec3> {
        (0..side.pow(3)).map(move |n| corner + IVec3::new(n % side, n / side % side, n / side / side).as_dvec3())
    }

    #[test]
    fn what_is_apart_is_two_pieces_and_crumbs_are_none() {
        let all: Vec<DVec3> =
            cube(3, DVec3::ZERO).chain(cube(4, DVec3::X * 5.0)).chain(cube(2, DVec3::Y * 9.0)).collect();
        let colours = vec![[200, 10, 10]; all.len()];
        let found = detections(&all, &colours, 1.0);
        let sizes: Vec<usize> = found.iter().map(|piece| piece.members.len()).collect();
        assert_eq!(sizes, [64, 27]);
        assert!(found[1].centre.abs_diff_eq(DVec3::ONE, 1e-12));
        // One point between them makes them one.
        let joined: Vec<DVec3> = all.into_iter().chain([DVec3::new(3.5, 1.0, 1.0)]).collect();
        assert_eq!(detections(&joined, &vec![[0; 3]; joined.len()], 1.0).len(), 1);
    }

    #[test]
    fn histograms_know_colours_of_their_own() {
        let red = Histogram::of(&[[220, 20, 20]; 30]);
        let green = Histogram::of(&[[20, 220, 20]; 30]);
        assert!((red.overlap(&red) - 1.0).abs() < 1e-12 && red.overlap(&green) < 0.1);
        assert!(red.speaks_for([200, 30, 0]) > 2.0 && red.speaks_for([0, 255, 0]) < -1.0);
        assert!(Histogram::mean([&red, &green]).overlap(&red) > 0.45);
        assert!(Histogram::of(&[]).overlap(&red).is_finite());
    }
}
