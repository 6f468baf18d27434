//! Gaussian parameters on the host, in the rows that the device uses.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::raster;

/// Floats of a core row: mean (3), log-scale (3), quaternion wxyz (4), opacity logit, padding.
pub const CORE: usize = raster::CORE_STRIDE as usize;

/// The zeroth SH basis function.
pub const SH_C0: f32 = 0.282_094_79;

/// Floats of a row of SH coefficients of `degree`; see [`raster::sh_stride`].
#[must_use]
pub const fn sh_stride(degree: u32) -> usize {
    raster::sh_stride(degree) as usize
}

/// Gaussians, a row each. The first [`Gaussians::dynamic`] rows are deformed by the field; the others never move.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// SH degree that the rows of `sh` have room for.
    pub sh_degree: u32,
    /// How many rows, from the first, are dynamic.
    pub dynamic: usize,
    /// Core rows of [`CORE`] floats.
    pub core: Vec<f32>,
    /// SH rows of [`sh_stride`] floats.
    pub sh: Vec<f32>,
    /// Floats of a row of `motion`: 0 where the motion model keeps nothing for each Gaussian.
    pub motion_floats: usize,
    /// What the motion model keeps for each dynamic Gaussian (none for the others): see [`crate::motion`].
    pub motion: Vec<f32>,
}

impl Gaussians {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.core.len() / CORE
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.core.is_empty()
    }

    /// Isotropic Gaussians at `points`, of the size of the mean distance to the three nearest others, with the points'
    /// colours and the same opacity (3DGS's initialisation). All are dynamic.
    #[must_use]
    pub fn from_points(points: &[([f32; 3], [u8; 3])], sh_degree: u32, opacity: f32) -> Self {
        let positions: Vec<[f32; 3]> = points.iter().map(|(position, _)| *position).collect();
        let distances = mean_squared_distance(&positions, 3);
        let least = least_squared_distance(&distances);
        let stride = sh_stride(sh_degree);
        let logit = (opacity / (1.0 - opacity)).ln();
        let sh = vec![0.0; points.len() * stride];
        let mut gaussians = Self { sh_degree, dynamic: points.len(), sh, ..Self::default() };
        for (index, ((position, colour), distance)) in points.iter().zip(&distances).enumerate() {
            let scale = distance.max(least).sqrt().ln();
            gaussians.core.extend_from_slice(position);
            gaussians.core.extend_from_slice(&[scale, scale, scale, 1.0, 0.0, 0.0, 0.0, logit, 0.0]);
            for (channel, &value) in colour.iter().enumerate() {
                gaussians.sh[index * stride + channel] = (f32::from(value) / 255.0 - 0.5) / SH_C0;
            }
        }
        gaussians
    }

    /// The mean of row `index`, metres.
    #[must_use]
    pub fn mean(&self, index: usize) -> [f32; 3] {
        let row = &self.core[index * CORE..];
        [row[0], row[1], row[2]]
    }

    /// The standard deviations of row `index` along its axes, metres.
    #[must_use]
    pub fn scale(&self, index: usize) -> [f32; 3] {
        let row = &self.core[index * CORE..];
        [row[3].exp(), row[4].exp(), row[5].exp()]
    }

    /// The opacity of row `index`, 0 to 1.
    #[must_use]
    pub fn opacity(&self, index: usize) -> f32 {
        sigmoid(self.core[index * CORE + 10])
    }

    /// The same Gaussians with room for SH of `degree`; coefficients that both have are kept.
    #[must_use]
    pub fn with_sh_degree(&self, degree: u32) -> Self {
        let (from, to) = (sh_stride(self.sh_degree), sh_stride(degree));
        let shared = 3 * ((self.sh_degree.min(degree) + 1) * (self.sh_degree.min(degree) + 1)) as usize;
        let mut sh = vec![0.0; self.len() * to];
        for (new, old) in sh.chunks_exact_mut(to).zip(self.sh.chunks_exact(from)) {
            new[..shared].copy_from_slice(&old[..shared]);
        }
        Self { sh_degree: degree, sh, ..self.clone() }
    }

    /// The same Gaussians with rows of `floats` floats for their motion; what is added is 0.
    #[must_use]
    pub fn with_motion_floats(self, floats: usize) -> Self {
        if self.motion_floats == floats || self.motion_floats == 0 {
            return Self { motion_floats: floats, ..self };
        }
        let mut motion = vec![0.0; self.motion.len() / self.motion_floats * floats];
        for (new, old) in motion.chunks_exact_mut(floats).zip(self.motion.chunks_exact(self.motion_floats)) {
            let kept = old.len().min(floats);
            new[..kept].copy_from_slice(&old[..kept]);
        }
        Self { motion_floats: floats, motion, ..self }
    }

    /// The rows `order` names, in that order, of which the first `dynamic` are dynamic; those must have been so before
    /// where the motion model keeps something for each.
    #[must_use]
    pub fn select(&self, order: &[usize], dynamic: usize) -> Self {
        Self {
            sh_degree: self.sh_degree,
            dynamic,
            core: select_rows(&self.core, CORE, order),
            sh: select_rows(&self.sh, sh_stride(self.sh_degree), order),
            motion_floats: self.motion_floats,
            motion: select_rows(&self.motion, self.motion_floats, &order[..dynamic]),
        }
    }
}

/// `1 / (1 + exp(-x))`.
#[must_use]
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// The rows of `stride` floats that `order` names.
#[must_use]
pub fn select_rows(rows: &[f32], stride: usize, order: &[usize]) -> Vec<f32> {
    order.iter().flat_map(|&index| &rows[index * stride..(index + 1) * stride]).copied().collect()
}

/// For each point the mean of the squared distances to its `count` nearest others; 0 for a lone point.
#[must_use]
pub fn mean_squared_distance(points: &[[f32; 3]], count: usize) -> Vec<f32> {
    if points.len() < 2 {
        return vec![0.0; points.len()];
    }
    let tree = Neighbours::new(points);
    points
        .iter()
        .map(|point| {
            let found = tree.nearest(point, count + 1);
            // The nearest is the point itself.
            let others = &found[1..];
            others.iter().map(|(_, distance)| distance).sum::<f32>() / others.len() as f32
        })
        .collect()
}

/// What squared distances are taken to be at least, so that points at one place have a size: a third of a millimetre, or a tenth of
/// the median distance where points lie closer than that.
fn least_squared_distance(squared: &[f32]) -> f32 {
    const LEAST: f32 = 1e-7;
    let mut squared = squared.to_vec();
    let middle = squared.len() / 2;
    if squared.is_empty() {
        return LEAST;
    }
    let median = *squared.select_nth_unstable_by(middle, f32::total_cmp).1;
    if median > 0.0 { LEAST.min(0.01 * median) } else { LEAST }
}

/// A search tree over points.
pub struct Neighbours {
    tree: Option<ImmutableKdTree<f32, 3>>,
}

impl std::fmt::Debug for Neighbours {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let points = self.tree.as_ref().map_or(0, ImmutableKdTree::size);
        formatter.debug_struct("Neighbours").field("points", &points).finish_non_exhaustive()
    }
}

impl Neighbours {
    /// A tree over `points`; points that are not finite are never found.
    #[must_use]
    pub fn new(points: &[[f32; 3]]) -> Self {
        // The tree wants finite numbers; these are farther than any that matter.
        let finite = |value: f32| if value.is_finite() { value.clamp(-1e15, 1e15) } else { 1e15 };
        let points: Vec<[f32; 3]> = points.iter().map(|point| point.map(finite)).collect();
        Self { tree: (!points.is_empty()).then(|| ImmutableKdTree::new_from_slice(&points)) }
    }

    /// Index and squared distance of the `count` nearest points (fewer where there are fewer), nearest first.
    #[must_use]
    pub fn nearest(&self, point: &[f32; 3], count: usize) -> Vec<(usize, f32)> {
        let Some(tree) = &self.tree else { return Vec::new() };
        let Some(count) = NonZero::new(count.min(tree.size())) else { return Vec::new() };
        let found = tree.nearest_n::<SquaredEuclidean>(point, count);
        found.into_iter().map(|found| (found.item as usize, found.distance)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_motion_grow_behind_what_they_hold() {
        let motion = vec![1.0, 2.0, 3.0, 4.0];
        let gaussians = Gaussians { dynamic: 2, motion_floats: 2, motion, ..Gaussians::default() };
        let grown = gaussians.with_motion_floats(3);
        assert_eq!((grown.motion_floats, grown.motion), (3, vec![1.0, 2.0, 0.0, 3.0, 4.0, 0.0]));
    }

    #[test]
    fn the_nearest_points_come_first() {
        let points = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let found = Neighbours::new(&points).nearest(&[0.9, 0.0, 0.0], 2);
        assert_eq!(found.iter().map(|(index, _)| *index).collect::<Vec<_>>(), [2, 0]);
    }

    #[test]
    fn neighbours_are_those_that_a_search_through_all_points_finds() {
        let unit = |i: u64| erfgs_base::random::uniform(erfgs_base::random::key(7, &[i])) as f32;
        // Half of them on a coarse grid, where coordinates and distances are often equal.
        let points: Vec<[f32; 3]> = (0..2000u64)
            .map(|i| {
                let point = [unit(3 * i), unit(3 * i + 1), unit(3 * i + 2)];
                if i % 2 == 0 { point } else { point.map(|x| (x * 5.0).round() / 5.0) }
            })
            .collect();
        let squared = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        let tree = Neighbours::new(&points);
        for point in points.iter().step_by(7).chain(&[[5.0, -1.0, 0.5]]) {
            let found = tree.nearest(point, 9);
            assert!(found.iter().all(|&(index, distance)| squared(point, &points[index]) == distance));
            let mut all: Vec<f32> = points.iter().map(|other| squared(point, other)).collect();
            all.sort_unstable_by(f32::total_cmp);
            assert_eq!(found.iter().map(|(_, distance)| *distance).collect::<Vec<_>>(), all[..9]);
        }
        assert_eq!(tree.nearest(&[0.0; 3], usize::MAX).len(), points.len());
    }

    #[test]
    fn many_equal_points_and_odd_ones_are_searched_without_failing() {
        let mut points = vec![[1.0, 2.0, 3.0]; 1000];
        points.push([f32::NAN, 0.0, 0.0]);
        assert_eq!(Neighbours::new(&points).nearest(&[1.0, 2.0, 3.0], 4).len(), 4);
        assert!(Neighbours::new(&[]).nearest(&[0.0; 3], 4).is_empty());
        assert_eq!(mean_squared_distance(&[[0.0; 3]], 3), [0.0]);
    }

    #[test]
    fn points_become_gaussians_of_their_colour_and_spacing() {
        let points: Vec<_> = (0..8).map(|i| ([i as f32 * 0.5, 0.0, 0.0], [255, 0, 128])).collect();
        let gaussians = Gaussians::from_points(&points, 1, 0.1);
        assert_eq!((gaussians.len(), gaussians.sh.len()), (8, 8 * 12));
        assert!((gaussians.opacity(3) - 0.1).abs() < 1e-6);
        let red = 0.5 + SH_C0 * gaussians.sh[0];
        assert!((red - 1.0).abs() < 1e-6);
        // Nearest three of an inner point: 0.5, 0.5, 1.0 away.
        assert!((gaussians.scale(3)[0] - 0.5f32.sqrt()).abs() < 1e-6);
        // A hundred thousand times smaller, they are as large as that.
        let small: Vec<_> = points.iter().map(|(position, colour)| (position.map(|x| 1e-5 * x), *colour)).collect();
        let ratio = Gaussians::from_points(&small, 1, 0.1).scale(3)[0] / gaussians.scale(3)[0];
        assert!((ratio / 1e-5 - 1.0).abs() < 1e-4, "{ratio}");
        let higher = gaussians.with_sh_degree(3);
        assert_eq!((higher.sh_degree, higher.sh.len(), higher.sh[48]), (3, 8 * 48, gaussians.sh[12]));
    }
}
