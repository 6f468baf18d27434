//! Event-guided densification: new Gaussians where events say that something moves and few Gaussians are.
//!
//! Pixels of a source event camera with events in a bin of time are unprojected to a row of depths; a point survives if
//! every event camera that is there saw events at its projection (cross-validation), if its ray has one run of surviving
//! depths (depth-wise uniqueness), if it is near the Gaussians as they stand at the start of the bin (spatial coherence)
//! and still near the same ones at its end (deformation consistency). Its canonical place is its place less the mean
//! displacement of those neighbours.

mod candidates;

use erfgs_base::random;

use crate::{
    config::{Coherence, EdsConfig},
    gaussians::{CORE, Gaussians, Neighbours, sh_stride},
    scene::Scene,
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
pub struct Draw {
    /// The bin of time.
    pub bin: usize,
    /// Whether lone events count as noise.
    pub denoise: bool,
    /// Keys the choice of source views and of candidates.
    pub seed: u64,
    /// Likewise.
    pub iteration: u64,
    /// Where Gaussians are free in time: what the new ones have of it.
    pub birth: Option<Birth>,
}

/// How a Gaussian that is free in time is born from events.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Birth {
    /// Its instant, the middle of the bin, RGB intervals.
    pub time: f32,
    /// Half the length of the bin, RGB intervals.
    pub half: f32,
    /// What its row stores of its life.
    pub log_life: f32,
}

/// Gaussians that the events of the bin ask for. They are all dynamic.
#[must_use]
pub fn propose(
    scene: &Scene,
    gaussians: &Gaussians,
    moving: Moving<'_>,
    config: &EdsConfig,
    draw: &Draw,
) -> (Gaussians, EdsReport) {
    let Draw { bin, denoise, seed, iteration, birth } = *draw;
    let mut report = EdsReport::default();
    let motion_floats = gaussians.motion_floats;
    let nothing = Gaussians { sh_degree: gaussians.sh_degree, motion_floats, ..Gaussians::default() };
    if scene.events.is_empty() || gaussians.is_empty() || bin + 1 >= scene.bins.edges.len() {
        return (nothing, report);
    }
    // Cameras that did not record then neither confirm nor deny.
    let there: Vec<usize> = (0..scene.events.len()).filter(|&view| scene.events[view].knows(bin, bin + 1)).collect();
    let activity: Vec<Option<Vec<f32>>> = (scene.events.iter())
        .map(|view| view.knows(bin, bin + 1).then(|| view.activity(bin, bin + 1, denoise)))
        .collect();
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
    let tree = Neighbours::new(moving.start);
    let coherent = coherent(points, &tree, config, random::key(seed, &[CHOICE, iteration]));
    report.coherent = coherent.len();
    let limit = config.max_distance * scene.extent;
    let mut new = nothing;
    for (point, neighbours) in coherent {
        let at_end = neighbours.iter().map(|&index| distance(&point, &moving.end[index])).sum::<f32>();
        // A neighbour that has gone by then has no place, and the sum is no number.
        if at_end.is_nan() || at_end > limit * neighbours.len() as f32 {
            continue;
        }
        append(&mut new, gaussians, &moving, &point, &neighbours, config);
        if let Some(birth) = birth {
            be_born(&mut new, &moving, &point, &neighbours, birth);
        }
    }
    new.dynamic = new.len();
    report.added = new.len();
    (new, report)
}

/// The candidates nearest to (or farthest from) their neighbours: twice as many as wanted, of which a random half stays.
fn coherent(points: Vec<[f32; 3]>, tree: &Neighbours, config: &EdsConfig, key: u64) -> Vec<([f32; 3], Vec<usize>)> {
    let mut scored: Vec<(f32, [f32; 3], Vec<usize>)> = points
        .into_iter()
        .filter_map(|point| {
            let found = tree.nearest(&point, config.neighbours as usize);
            let mean = found.iter().map(|(_, squared)| squared.sqrt()).sum::<f32>() / found.len() as f32;
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

fn append(
    new: &mut Gaussians,
    gaussians: &Gaussians,
    moving: &Moving<'_>,
    point: &[f32; 3],
    neighbours: &[usize],
    config: &EdsConfig,
) {
    let weight = 1.0 / neighbours.len() as f32;
    let mut canonical = *point;
    let mut squared = 0.0;
    let mut colour = [0.0; 3];
    let stride = sh_stride(gaussians.sh_degree);
    for &index in neighbours {
        let (here, origin) = (moving.start[index], gaussians.mean(index));
        for axis in 0..3 {
            canonical[axis] -= weight * (here[axis] - origin[axis]);
        }
        squared += weight * distance(point, &here).powi(2);
        for (sum, value) in colour.iter_mut().zip(&gaussians.sh[index * stride..]) {
            *sum += weight * value;
        }
    }
    let log_scale = (squared.max(1e-7).sqrt() / 6.0).ln();
    new.core.extend_from_slice(&canonical);
    new.core.extend_from_slice(&[log_scale, log_scale, log_scale, 1.0, 0.0, 0.0, 0.0, config.opacity_logit, 0.0]);
    new.sh.extend_from_slice(&colour);
    new.sh.resize(new.core.len() / CORE * stride, 0.0);
}

/// Gives the last row of `new` its place at its instant, and the mean velocity of its neighbours over the bin.
fn be_born(new: &mut Gaussians, moving: &Moving<'_>, point: &[f32; 3], neighbours: &[usize], birth: Birth) {
    let weight = 1.0 / (neighbours.len() as f32 * 2.0 * birth.half.max(1e-6));
    let velocity: [f32; 3] = std::array::from_fn(|axis| {
        neighbours.iter().map(|&index| weight * (moving.end[index][axis] - moving.start[index][axis])).sum()
    });
    let row = new.core.len() - CORE;
    // The point was seen somewhere within the bin.
    new.core[row..row + 3].copy_from_slice(point);
    let [x, y, z] = velocity;
    new.motion.extend([x, y, z, birth.time, 0.0, 0.0, 0.0, birth.log_life]);
}

fn distance(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}
