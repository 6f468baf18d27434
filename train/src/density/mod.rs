//! Adaptive density control: clone, split, prune, opacity reset (3DGS), on the host. Runs once in a hundred iterations or
//! fewer, so that its copies do not matter.

mod statistics;

use erfgs_base::random;

use crate::config::DensityConfig;
use erfgs_splat::gaussians::{CORE, Gaussians, select_rows, sh_stride};

pub use statistics::Statistics;

const SPLIT: u64 = 0x0073_706c_6974;

/// Adam's moments, in the rows of the parameters.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    /// First moments of the core rows.
    pub core_first: Vec<f32>,
    /// Second moments of the core rows.
    pub core_second: Vec<f32>,
    /// First moments of the SH rows.
    pub sh_first: Vec<f32>,
    /// Second moments of the SH rows.
    pub sh_second: Vec<f32>,
    /// First moments of the rows of motion.
    pub motion_first: Vec<f32>,
    /// Second moments of the rows of motion.
    pub motion_second: Vec<f32>,
}

impl Moments {
    /// Zero moments for `gaussians`.
    #[must_use]
    pub fn zero(gaussians: &Gaussians) -> Self {
        let zeros = |like: &Vec<f32>| vec![0.0; like.len()];
        let [core, sh, motion] = [&gaussians.core, &gaussians.sh, &gaussians.motion].map(zeros);
        Self {
            core_first: core.clone(),
            core_second: core,
            sh_first: sh.clone(),
            sh_second: sh,
            motion_first: motion.clone(),
            motion_second: motion,
        }
    }
}

/// Gaussians and their moments.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Population {
    /// Their parameters.
    pub gaussians: Gaussians,
    /// Adam's moments of the parameters, row by row.
    pub moments: Moments,
}

impl Population {
    /// The rows of `order`, of which the first `dynamic` are dynamic.
    #[must_use]
    pub fn select(&self, order: &[usize], dynamic: usize) -> Self {
        let stride = sh_stride(self.gaussians.sh_degree);
        let moments = Moments {
            core_first: select_rows(&self.moments.core_first, CORE, order),
            core_second: select_rows(&self.moments.core_second, CORE, order),
            sh_first: select_rows(&self.moments.sh_first, stride, order),
            sh_second: select_rows(&self.moments.sh_second, stride, order),
            motion_first: select_rows(&self.moments.motion_first, self.gaussians.motion_floats, &order[..dynamic]),
            motion_second: select_rows(&self.moments.motion_second, self.gaussians.motion_floats, &order[..dynamic]),
        };
        Self { gaussians: self.gaussians.select(order, dynamic), moments }
    }

    /// The rows sorted so that those marked in `moves` come first.
    #[must_use]
    pub fn partition(&self, moves: &[bool]) -> Self {
        let (mut order, still): (Vec<usize>, Vec<usize>) = (0..moves.len()).partition(|&index| moves[index]);
        let dynamic = order.len();
        order.extend(still);
        self.select(&order, dynamic)
    }

    /// With dynamic rows added, whose moments are zero.
    #[must_use]
    pub fn with_dynamic(&self, rows: &Gaussians) -> Self {
        let at = self.gaussians.dynamic;
        let stride = sh_stride(self.gaussians.sh_degree);
        let insert = |old: &[f32], stride: usize, new: &[f32]| [&old[..at * stride], new, &old[at * stride..]].concat();
        let zeros = vec![0.0; rows.core.len().max(rows.sh.len()).max(rows.motion.len())];
        let motion_floats = if at == 0 { rows.motion_floats } else { self.gaussians.motion_floats };
        let append = |old: &[f32], new: &[f32]| [old, new].concat();
        Self {
            gaussians: Gaussians {
                sh_degree: self.gaussians.sh_degree,
                dynamic: at + rows.len(),
                core: insert(&self.gaussians.core, CORE, &rows.core),
                sh: insert(&self.gaussians.sh, stride, &rows.sh),
                motion_floats,
                motion: append(&self.gaussians.motion, &rows.motion),
            },
            moments: Moments {
                core_first: insert(&self.moments.core_first, CORE, &zeros[..rows.core.len()]),
                core_second: insert(&self.moments.core_second, CORE, &zeros[..rows.core.len()]),
                sh_first: insert(&self.moments.sh_first, stride, &zeros[..rows.sh.len()]),
                sh_second: insert(&self.moments.sh_second, stride, &zeros[..rows.sh.len()]),
                motion_first: append(&self.moments.motion_first, &zeros[..rows.motion.len()]),
                motion_second: append(&self.moments.motion_second, &zeros[..rows.motion.len()]),
            },
        }
    }

    /// The rows before `row`, and those from there on, which stand still.
    #[must_use]
    pub fn split_at(&self, row: usize) -> [Self; 2] {
        let rows = |range: std::ops::Range<usize>, dynamic| self.select(&range.collect::<Vec<usize>>(), dynamic);
        [rows(0..row, self.gaussians.dynamic), rows(row..self.gaussians.len(), 0)]
    }

    /// With rows behind its own that stand still.
    #[must_use]
    pub fn followed_by(mut self, still: &Self) -> Self {
        let (gaussians, moments) = (&mut self.gaussians, &mut self.moments);
        gaussians.core.extend(&still.gaussians.core);
        gaussians.sh.extend(&still.gaussians.sh);
        moments.core_first.extend(&still.moments.core_first);
        moments.core_second.extend(&still.moments.core_second);
        moments.sh_first.extend(&still.moments.sh_first);
        moments.sh_second.extend(&still.moments.sh_second);
        self
    }

    /// Opacities of at most `limit`, their moments zero.
    pub fn reset_opacity(&mut self, limit: f32) {
        let logit = (limit / (1.0 - limit)).ln();
        for index in 0..self.gaussians.len() {
            let at = index * CORE + 10;
            self.gaussians.core[at] = self.gaussians.core[at].min(logit);
            self.moments.core_first[at] = 0.0;
            self.moments.core_second[at] = 0.0;
        }
    }
}

/// What a Gaussian did on screen since the last densification.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScreenStatistics {
    /// Sum over iterations of the norm of the screen-space gradient, NDC units.
    pub gradient: f32,
    /// Iterations in which any view saw it.
    pub iterations: f32,
    /// Largest radius, pixels.
    pub radius_px: f32,
}

impl ScreenStatistics {
    fn mean_gradient(&self) -> f32 {
        if self.iterations > 0.0 { self.gradient / self.iterations } else { 0.0 }
    }
}

/// How the population changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Change {
    /// Gaussians cloned.
    pub cloned: usize,
    /// Gaussians split in two.
    pub split: usize,
    /// Gaussians removed.
    pub pruned: usize,
}

/// Scene facts that the thresholds refer to.
#[derive(Clone, Copy, Debug)]
pub struct Measures {
    /// The scene's extent, metres.
    pub extent: f32,
    /// Width of the images, pixels.
    pub width_px: f32,
    /// Seed of the split.
    pub seed: u64,
    /// Iteration, which keys the split.
    pub iteration: u64,
}

/// Clones small Gaussians and splits large ones whose screen-space gradient is high, and prunes.
#[must_use]
pub fn densify(
    population: &Population,
    statistics: &[ScreenStatistics],
    config: &DensityConfig,
    grow: bool,
    measures: &Measures,
) -> (Population, Change) {
    let gaussians = &population.gaussians;
    let count = gaussians.len();
    let prune = count as u32 > config.prune_above;
    let removed: Vec<bool> =
        (0..count).map(|index| is_removed(gaussians, statistics, config, prune, measures, index)).collect();
    let mut candidates: Vec<usize> = if grow { (0..count).collect() } else { Vec::new() };
    candidates.retain(|&index| !removed[index] && statistics[index].mean_gradient() >= config.gradient_threshold);
    let room = (config.max_gaussians as usize).saturating_sub(count);
    if candidates.len() > room {
        // The most needed first; the index decides between equals, so that the result does not depend on the sort.
        candidates
            .sort_by(|&a, &b| statistics[b].mean_gradient().total_cmp(&statistics[a].mean_gradient()).then(a.cmp(&b)));
        candidates.truncate(room);
    }
    let split_size = config.split_extent * measures.extent;
    let largest = |index: usize| gaussians.scale(index).into_iter().fold(0.0, f32::max);
    let mut grows = vec![Growth::None; count];
    for index in candidates {
        grows[index] = if largest(index) > split_size { Growth::Split } else { Growth::Clone };
    }
    let mut change = Change { pruned: removed.iter().filter(|&&removed| removed).count(), ..Change::default() };
    let mut order = Vec::with_capacity(count);
    let mut added = Vec::new();
    let mut dynamic = 0;
    for (range, moves) in [(0..gaussians.dynamic, true), (gaussians.dynamic..count, false)] {
        let kept: Vec<usize> = range.filter(|&index| !removed[index]).collect();
        order.extend(kept.iter().filter(|&&index| grows[index] != Growth::Split));
        for &index in &kept {
            match grows[index] {
                Growth::None => {}
                Growth::Clone => {
                    added.push((order.len(), index, None));
                    order.push(index);
                    change.cloned += 1;
                }
                Growth::Split => {
                    for child in 0..2 {
                        added.push((order.len(), index, Some(child)));
                        order.push(index);
                    }
                    change.split += 1;
                }
            }
        }
        if moves {
            dynamic = order.len();
        }
    }
    let mut result = population.select(&order, dynamic);
    let stride = sh_stride(gaussians.sh_degree);
    for (row, parent, child) in added {
        if let Some(child) = child {
            split(&mut result.gaussians.core[row * CORE..(row + 1) * CORE], parent, child, measures);
        }
        for (moments, stride) in [
            (&mut result.moments.core_first, CORE),
            (&mut result.moments.core_second, CORE),
            (&mut result.moments.sh_first, stride),
            (&mut result.moments.sh_second, stride),
        ] {
            moments[row * stride..(row + 1) * stride].fill(0.0);
        }
        if row < dynamic {
            let of_row = row * gaussians.motion_floats..(row + 1) * gaussians.motion_floats;
            result.moments.motion_first[of_row.clone()].fill(0.0);
            result.moments.motion_second[of_row].fill(0.0);
        }
    }
    (result, change)
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Growth {
    None,
    Clone,
    Split,
}

fn is_removed(
    gaussians: &Gaussians,
    statistics: &[ScreenStatistics],
    config: &DensityConfig,
    prune: bool,
    measures: &Measures,
    index: usize,
) -> bool {
    let row = &gaussians.core[index * CORE..(index + 1) * CORE];
    let motion = match index < gaussians.dynamic {
        true => &gaussians.motion[index * gaussians.motion_floats..(index + 1) * gaussians.motion_floats],
        false => &[],
    };
    if row.iter().chain(motion).any(|value| !value.is_finite()) {
        return true;
    }
    let largest = gaussians.scale(index).into_iter().fold(0.0, f32::max);
    prune
        && (gaussians.opacity(index) < config.min_opacity
            || config.max_extent > 0.0 && largest > config.max_extent * measures.extent
            || config.max_screen > 0.0 && statistics[index].radius_px > config.max_screen * measures.width_px)
}

/// Moves a copy of its parent to a random place within the parent and makes it smaller by 1.6.
fn split(core: &mut [f32], parent: usize, child: u64, measures: &Measures) {
    let normal = |axis: u64| {
        let key = random::key(measures.seed, &[SPLIT, measures.iteration, parent as u64, child, axis]);
        random::normal(key) as f32
    };
    let scale = glam::Vec3::new(core[3], core[4], core[5]).exp();
    let offset = glam::Vec3::new(normal(0), normal(1), normal(2)) * scale;
    let raw = glam::Vec4::new(core[7], core[8], core[9], core[6]);
    // The zero quaternion has no direction; such a Gaussian is drawn unrotated.
    let rotation = raw.try_normalize().map_or(glam::Quat::IDENTITY, glam::Quat::from_vec4);
    let moved = rotation * offset;
    for axis in 0..3 {
        core[axis] += moved[axis];
        core[3 + axis] -= 1.6f32.ln();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    const MEASURES: Measures = Measures { extent: 1.0, width_px: 100.0, seed: 1, iteration: 500 };

    fn population(scales: &[f32], dynamic: usize) -> Population {
        let points: Vec<_> = (0..scales.len()).map(|i| ([i as f32, 0.0, 0.0], [100, 100, 100])).collect();
        let mut gaussians = Gaussians::from_points(&points, 0, 0.5);
        for (index, scale) in scales.iter().enumerate() {
            gaussians.core[index * CORE + 3..index * CORE + 6].fill(scale.ln());
        }
        gaussians.dynamic = dynamic;
        let mut moments = Moments::zero(&gaussians);
        moments.core_first.fill(7.0);
        Population { gaussians, moments }
    }

    fn hot(count: usize) -> Vec<ScreenStatistics> {
        vec![ScreenStatistics { gradient: 1.0, iterations: 2.0, radius_px: 1.0 }; count]
    }

    fn config() -> DensityConfig {
        DensityConfig {
            max_gaussians: 1000,
            prune_above: 0,
            max_extent: 0.0,
            max_screen: 0.0,
            ..Config::default().density
        }
    }

    #[test]
    fn small_ones_are_cloned_and_large_ones_split_inside_their_own_block() {
        let before = population(&[0.001, 0.5, 0.001], 2);
        let (after, change) = densify(&before, &hot(3), &config(), true, &MEASURES);
        assert_eq!(change, Change { cloned: 2, split: 1, pruned: 0 });
        // Dynamic: the clone's parent, its copy, two halves. Static: parent and copy.
        assert_eq!((after.gaussians.len(), after.gaussians.dynamic), (6, 4));
        assert_eq!(after.gaussians.mean(0), after.gaussians.mean(1));
        assert!((after.gaussians.scale(2)[0] - 0.5 / 1.6).abs() < 1e-6);
        assert_ne!(after.gaussians.mean(2), after.gaussians.mean(3));
        assert_eq!(after.moments.core_first[0], 7.0, "who was there keeps its moments");
        assert_eq!(after.moments.core_first[CORE], 0.0, "who is new starts without");
    }

    #[test]
    fn transparent_and_broken_ones_go() {
        let mut before = population(&[0.001; 4], 2);
        before.gaussians.core[10] = -20.0;
        before.gaussians.core[3 * CORE] = f32::NAN;
        let (after, change) = densify(&before, &[ScreenStatistics::default(); 4], &config(), true, &MEASURES);
        assert_eq!((change.pruned, after.gaussians.len(), after.gaussians.dynamic), (2, 2, 1));
    }

    #[test]
    fn the_limit_lets_the_most_needed_grow_first() {
        let mut statistics = hot(4);
        statistics[2].gradient = 9.0;
        let config = DensityConfig { max_gaussians: 5, ..config() };
        let (after, change) = densify(&population(&[0.001; 4], 0), &statistics, &config, true, &MEASURES);
        assert_eq!((change.cloned, after.gaussians.len()), (1, 5));
        assert_eq!(after.gaussians.mean(4)[0], 2.0);
    }

    #[test]
    fn an_opacity_reset_lowers_and_never_raises() {
        let mut population = population(&[0.1; 2], 0);
        population.gaussians.core[10] = -9.0;
        population.reset_opacity(0.01);
        assert_eq!(population.gaussians.core[10], -9.0);
        assert!((population.gaussians.opacity(1) - 0.01).abs() < 1e-6);
    }

    #[test]
    fn what_the_motion_keeps_of_a_gaussian_goes_with_it() {
        let mut before = population(&[0.001, 0.5, 0.001], 2);
        before.gaussians.motion_floats = 2;
        before.gaussians.motion = vec![1.0, 2.0, 3.0, 4.0];
        before.moments = Moments::zero(&before.gaussians);
        before.moments.motion_first.fill(5.0);
        let (after, _) = densify(&before, &hot(3), &config(), true, &MEASURES);
        assert_eq!(after.gaussians.dynamic, 4);
        assert_eq!(after.gaussians.motion, [1.0, 2.0, 1.0, 2.0, 3.0, 4.0, 3.0, 4.0]);
        assert_eq!(after.moments.motion_first, [5.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let more = after.with_dynamic(&before.select(&[1], 1).gaussians);
        assert_eq!((more.gaussians.dynamic, &more.gaussians.motion[8..]), (5, &[3.0, 4.0][..]));
        assert_eq!(more.moments.motion_second.len(), 10);
        let mut broken = before;
        broken.gaussians.motion[3] = f32::NAN;
        let (left, change) = densify(&broken, &hot(3), &config(), false, &MEASURES);
        assert_eq!((change.pruned, left.gaussians.dynamic, left.gaussians.motion.len()), (1, 1, 2));
    }

    #[test]
    fn new_dynamic_rows_come_before_the_static_ones() {
        let before = population(&[0.1, 0.2, 0.3], 1);
        let rows = population(&[0.9, 0.8], 2).gaussians;
        let after = before.with_dynamic(&rows);
        assert_eq!((after.gaussians.len(), after.gaussians.dynamic), (5, 3));
        assert!((after.gaussians.scale(1)[0] - 0.9).abs() < 1e-6 && (after.gaussians.scale(3)[0] - 0.2).abs() < 1e-6);
        assert_eq!(after.moments.core_first[CORE], 0.0);
    }
}
