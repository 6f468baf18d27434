//! Event-guided densification: new Gaussians where events say that something moves and few Gaussians are.
//!
//! Pixels of a source event camera with events in a bin of time are unprojected to a row of depths; a point survives if
//! the event cameras that are there saw events at its projection (cross-validation), if it is the one that its ray gives
//! (depth-wise uniqueness), if it is near the Gaussians as they stand in the bin (spatial coherence) and still near the same
//! ones at its end (deformation consistency). Its canonical place is its place less the mean displacement of those neighbours.
//! [`EdsConfig`] says where the paper, its released code and the default differ.

mod candidates;

use erfgs_base::random;

use crate::{
    config::{Coherence, EdsConfig},
    scene::{Scene, SceneError},
};
use erfgs_splat::{
    gaussians::{CORE, Gaussians, Neighbours, sh_stride},
    motion::FreeTimeOptions,
};

const VIEWS: u64 = 0x6564_7376;
const CHOICE: u64 = 0x6564_7363;

/// What came of one call, step by step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EdsReport {
    /// Rays of pixels with events.
    pub rays: usize,
    /// Rays with one surviving run of depths.
    pub validated: usize,
    /// Candidates left by spatial coherence.
    pub coherent: usize,
    /// Candidates left by deformation consistency: the Gaussians added.
    pub added: usize,
}

/// A moment of the deformed scene.
#[derive(Clone, Copy, Debug)]
pub struct Moving<'a> {
    /// Means at the start of the bin, metres, a row for each Gaussian.
    pub start: &'a [[f32; 3]],
    /// Means at its end.
    pub end: &'a [[f32; 3]],
}

/// Which events are looked at.
#[derive(Clone, Copy, Debug)]
pub struct Draw<'a> {
    /// The bin of time.
    pub bin: usize,
    /// Whether lone events count as noise.
    pub denoise: bool,
    /// Keys the choice of source views and of candidates.
    pub seed: u64,
    /// Likewise.
    pub iteration: u64,
    /// Where Gaussians are free in time: what the new ones have of it.
    pub birth: Option<Birth<'a>>,
}

/// How a Gaussian that is free in time is born from events.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Birth<'a> {
    /// Its instant, the middle of the bin, RGB intervals.
    pub time: f32,
    /// Half the length of the bin, RGB intervals.
    pub half: f32,
    /// What its row looks like.
    pub options: &'a FreeTimeOptions,
}

/// Gaussians that the events of the bin ask for. They are all dynamic. `carry` says where the field takes canonical places by
/// the end of the bin.
///
/// # Errors
/// Those of `carry`, and [`SceneError`] where events cannot be read any more.
pub fn propose<E: From<SceneError>>(
    scene: &Scene,
    gaussians: &Gaussians,
    moving: Moving<'_>,
    config: &EdsConfig,
    draw: &Draw<'_>,
    carry: impl FnOnce(&[[f32; 3]]) -> Result<Vec<[f32; 3]>, E>,
) -> Result<(Gaussians, EdsReport), E> {
    let Draw { bin, denoise, seed, iteration, birth } = *draw;
    let mut report = EdsReport::default();
    // Bodies keep more behind the path of a row than a birth knows of.
    let motion_floats = birth.map_or(gaussians.motion_floats, |birth| birth.options.floats());
    let nothing = Gaussians { sh_degree: gaussians.sh_degree, motion_floats, ..Gaussians::default() };
    if scene.events.is_empty() || gaussians.is_empty() || bin + 1 >= scene.bins.edges.len() {
        return Ok((nothing, report));
    }
    // Cameras that did not record then neither confirm nor deny.
    let there: Vec<usize> = (0..scene.events.len()).filter(|&view| scene.events[view].knows(bin, bin + 1)).collect();
    let activity: Vec<Option<Vec<f32>>> = (scene.events.iter())
        .map(|view| view.knows(bin, bin + 1).then(|| view.activity(bin, bin + 1, denoise)).transpose())
        .collect::<Result<_, SceneError>>()?;
    let order = random::permutation(random::key(seed, &[VIEWS, iteration]), there.len());
    let sources = if there.len() > config.sources as usize { config.sources.max(1) as usize } else { 1 };
    // Depths are looked for where things move, if it is known what can move at all.
    let movers = if gaussians.dynamic > 0 { gaussians.dynamic } else { gaussians.len() };
    let mut points = Vec::new();
    for &source in order.iter().take(sources) {
        let found = candidates::find(scene, &activity, there[source], &moving.start[..movers], config);
        report.rays += found.rays;
        points.extend(found.points);
    }
    report.validated = points.len();
    let coherent = coherent(points, &moving, config, random::key(seed, &[CHOICE, iteration]));
    report.coherent = coherent.len();
    let ends = match (config.own_deformation, birth) {
        (false, _) => coherent.iter().map(|(point, _)| *point).collect(),
        (true, None) => {
            let canonical: Vec<[f32; 3]> =
                coherent.iter().map(|(point, near)| canonical(gaussians, &moving, point, near)).collect();
            carry(&canonical)?
        }
        (true, Some(birth)) => coherent
            .iter()
            .map(|(point, near)| {
                let velocity = mean_velocity(&moving, near, birth);
                std::array::from_fn(|axis| point[axis] + 2.0 * birth.half * velocity[axis])
            })
            .collect::<Vec<[f32; 3]>>(),
    };
    let limit = config.max_distance * scene.extent;
    // What lies on its neighbours has the size of a fraction of a millimetre, or less in a small scene.
    let least = f32::min(1e-7, (1e-3 * scene.extent).powi(2));
    let mut new = nothing;
    for ((point, neighbours), end) in coherent.into_iter().zip(ends) {
        let at_end = neighbours.iter().map(|&index| distance(&end, &moving.end[index])).sum::<f32>();
        // A neighbour that has gone by then has no place, and the sum is no number.
        if at_end.is_nan() || at_end > limit * neighbours.len() as f32 {
            continue;
        }
        append(&mut new, gaussians, &moving, &point, &neighbours, config, least);
        if let Some(birth) = birth {
            be_born(&mut new, &moving, &point, &neighbours, birth);
        }
    }
    new.dynamic = new.len();
    report.added = new.len();
    Ok((new, report))
}

/// The candidates nearest to (or farthest from) their neighbours: twice as many as wanted, of which a random half stays.
fn coherent(points: Vec<[f32; 3]>, moving: &Moving<'_>, config: &EdsConfig, key: u64) -> Vec<([f32; 3], Vec<usize>)> {
    let tree = Neighbours::new(moving.start);
    let at_end = config.both_ends.then(|| Neighbours::new(moving.end));
    let mean_distance =
        |found: &[(usize, f32)]| found.iter().map(|(_, squared)| squared.sqrt()).sum::<f32>() / found.len() as f32;
    let mut scored: Vec<(f32, [f32; 3], Vec<usize>)> = points
        .into_iter()
        .filter_map(|point| {
            let found = tree.nearest(&point, config.neighbours as usize);
            let at_end = at_end.as_ref().map(|tree| mean_distance(&tree.nearest(&point, config.neighbours as usize)));
            let mean = at_end.into_iter().fold(mean_distance(&found), f32::min);
            mean.is_finite().then(|| (mean, point, found.into_iter().map(|(index, _)| index).collect()))
        })
        .collect();
    scored.sort_by(|a, b| match config.coherence {
        Coherence::Smallest => a.0.total_cmp(&b.0),
        Coherence::Largest => b.0.total_cmp(&a.0),
    });
    let wanted = config.count as usize;
    scored.truncate(2 * wanted);
    if scored.len() < 2 * wanted {
        return scored.into_iter().map(|(_, point, neighbours)| (point, neighbours)).collect();
    }
    let order = random::permutation(key, scored.len());
    order.into_iter().take(wanted).map(|index| (scored[index].1, scored[index].2.clone())).collect()
}

/// The place of a point less the mean displacement of its neighbours.
fn canonical(gaussians: &Gaussians, moving: &Moving<'_>, point: &[f32; 3], neighbours: &[usize]) -> [f32; 3] {
    let weight = 1.0 / neighbours.len() as f32;
    let mut canonical = *point;
    for &index in neighbours {
        let (here, origin) = (moving.start[index], gaussians.mean(index));
        for axis in 0..3 {
            canonical[axis] -= weight * (here[axis] - origin[axis]);
        }
    }
    canonical
}

/// The mean velocity of some Gaussians over the bin, metres an interval.
fn mean_velocity(moving: &Moving<'_>, neighbours: &[usize], birth: Birth<'_>) -> [f32; 3] {
    let weight = 1.0 / (neighbours.len() as f32 * 2.0 * birth.half.max(1e-6));
    std::array::from_fn(|axis| {
        neighbours.iter().map(|&index| weight * (moving.end[index][axis] - moving.start[index][axis])).sum()
    })
}

fn append(
    new: &mut Gaussians,
    gaussians: &Gaussians,
    moving: &Moving<'_>,
    point: &[f32; 3],
    neighbours: &[usize],
    config: &EdsConfig,
    least: f32,
) {
    let weight = 1.0 / neighbours.len() as f32;
    let canonical = canonical(gaussians, moving, point, neighbours);
    let mut squared = 0.0;
    let mut colour = [0.0; 3];
    let stride = sh_stride(gaussians.sh_degree);
    for &index in neighbours {
        let here = moving.start[index];
        squared += weight * distance(point, &here).powi(2);
        for (sum, value) in colour.iter_mut().zip(&gaussians.sh[index * stride..]) {
            *sum += weight * value;
        }
    }
    let log_scale = (squared.max(least).sqrt() / 6.0).ln();
    new.core.extend_from_slice(&canonical);
    new.core.extend_from_slice(&[log_scale, log_scale, log_scale, 1.0, 0.0, 0.0, 0.0, config.opacity_logit, 0.0]);
    new.sh.extend_from_slice(&colour);
    new.sh.resize(new.core.len() / CORE * stride, 0.0);
}

/// Gives the last row of `new` its place at its instant, and the mean velocity of its neighbours over the bin.
fn be_born(new: &mut Gaussians, moving: &Moving<'_>, point: &[f32; 3], neighbours: &[usize], birth: Birth<'_>) {
    let velocity = mean_velocity(moving, neighbours, birth);
    let row = new.core.len() - CORE;
    // The point was seen somewhere within the bin.
    new.core[row..row + 3].copy_from_slice(point);
    new.motion.extend(birth.options.born(birth.time, velocity));
}

fn distance(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    /// Two Gaussians that the field takes one metre along x within the bin.
    fn gaussians() -> (Gaussians, Vec<[f32; 3]>, Vec<[f32; 3]>) {
        let points = [([0.0, 0.0, 0.0], [9; 3]), ([0.0, 0.2, 0.0], [9; 3])];
        let gaussians = Gaussians::from_points(&points, 0, 0.5);
        let start = vec![[0.5, 0.0, 0.0], [0.5, 0.2, 0.0]];
        let end = vec![[1.5, 0.0, 0.0], [1.5, 0.2, 0.0]];
        (gaussians, start, end)
    }

    #[test]
    fn a_point_that_the_gaussians_reach_at_the_end_is_coherent_with_both_ends() {
        let (_, start, end) = gaussians();
        let moving = Moving { start: &start, end: &end };
        let eds = |both_ends| EdsConfig { both_ends, neighbours: 2, count: 1, ..Config::default().eds };
        // The first is near them at the start, the second, a little nearer, at the end.
        let points = vec![[0.5, 0.1, 0.1], [1.5, 0.1, 0.05], [5.0, 0.0, 0.0]];
        let kept = |both_ends| {
            let kept = coherent(points.clone(), &moving, &eds(both_ends), 1);
            assert_eq!(kept.len(), 1, "one of the two best");
            let mut two = coherent(points.clone(), &moving, &EdsConfig { count: 2, ..eds(both_ends) }, 1);
            two.truncate(1);
            two[0].0
        };
        assert_eq!((kept(false), kept(true)), (points[0], points[1]));
    }

    #[test]
    fn a_canonical_place_is_taken_back_by_what_the_neighbours_moved() {
        let (gaussians, start, end) = gaussians();
        let moving = Moving { start: &start, end: &end };
        assert_eq!(canonical(&gaussians, &moving, &[0.6, 0.1, 0.0], &[0, 1]), [0.6 - 0.5, 0.1, 0.0]);
        let birth = Birth { time: 3.0, half: 0.125, options: &FreeTimeOptions::default() };
        assert_eq!(mean_velocity(&moving, &[0, 1], birth), [4.0, 0.0, 0.0]);
    }
}
