//! How two cameras stand to each other, from the wands that both saw.
//!
//! Each camera alone places every wand in its own frame, in metres (`view.rs`), so that the motion between two cameras is
//! an alignment of points: no essential matrix, and nothing special about wands that stay in a plane. The single views'
//! distances are rough; motions from random samples are therefore judged by how well rays meet, which does not depend on
//! distances, and the best is refined by an adjustment of the two cameras.

use erfgs_base::random;
use erfgs_scene::{Intrinsics, Pose};
use glam::DVec3;

use super::{
    Stick,
    instants::{Instant, WandView},
    place,
};
use crate::{
    bundle::{Bundle, BundleCamera, BundleError, Loss, Options, Parameter},
    geometry::rigid,
};

const SAMPLE: u64 = random::purpose("wand pair sample");
/// Samples tried.
const SAMPLES: u64 = 200;
/// Wands in a sample.
const SIZE: usize = 3;
/// A pair is estimated from at most so many placements, spread evenly.
const MOST: usize = 48;
/// A ray that misses by more, in pixels, counts no more than this.
const MISS_PX: f64 = 25.0;
/// A pair's wand whose LEDs are all this near to where they should be agrees, as a share of the focal length.
const AGREES: f64 = 0.005;

/// Two cameras in one frame.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    /// From the first camera's space to the second's.
    pub motion: Pose,
    /// The share of placements that agree.
    pub agreeing: f64,
    /// How many agree.
    pub count: usize,
}

/// The placements in which both cameras see a wand that could be one.
pub(super) fn shared<'a>(instants: &[&'a Instant], a: usize, b: usize) -> Vec<[&'a WandView; 2]> {
    let of = |instant: &'a Instant, camera| instant.views.iter().find(|v| v.camera == camera && v.lone.is_some());
    instants.iter().filter_map(|instant| Some([of(instant, a)?, of(instant, b)?])).collect()
}

/// The motion between two cameras from the wands that both saw; `None` where no motion explains enough of them.
pub(super) fn pair(
    stick: &Stick,
    lenses: [&Intrinsics; 2],
    views: &[[&WandView; 2]],
    seed: u64,
) -> Result<Option<Pair>, BundleError> {
    let stride = views.len().div_ceil(MOST).max(1);
    let views: Vec<[&WandView; 2]> = views.iter().step_by(stride).copied().collect();
    let focal = (lenses[0].fx * lenses[1].fx).sqrt();
    let mut best: Option<(f64, Pose)> = None;
    let mut consider = |motion: Option<Pose>| {
        let Some(motion) = motion else { return };
        let cost = views.iter().map(|views| misses(&motion, views, focal).min(MISS_PX)).sum();
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, motion));
        }
    };
    for sample in 0..SAMPLES {
        let key = random::key(seed, &[SAMPLE, sample]);
        let chosen: Vec<_> = (0..SIZE.min(views.len()))
            .map(|draw| views[random::below(random::extend(key, draw as u64), views.len() as u64) as usize])
            .collect();
        let motion = align(&chosen);
        consider(motion);
        // The same with all that the sample agrees with.
        if let Some(motion) = motion.filter(|_| sample % 8 == 0) {
            let near: Vec<_> = views.iter().copied().filter(|v| misses(&motion, v, focal) < MISS_PX).collect();
            consider(align(&near));
        }
    }
    let Some((_, motion)) = best else { return Ok(None) };
    refine(stick, lenses, &views, motion)
}

/// The motion that aligns the single views' wands.
fn align(views: &[[&WandView; 2]]) -> Option<Pose> {
    let lone = |view: &WandView| view.lone;
    let pairs: Vec<(DVec3, DVec3, f64)> = views
        .iter()
        .filter_map(|views| Some((lone(views[0])?, lone(views[1])?)))
        .flat_map(|(a, b)| {
            let weight = 1.0 / (1.0 / a.weight + 1.0 / b.weight);
            (0..3).map(move |i| (a.points[i], b.points[i], weight))
        })
        .collect();
    rigid(&pairs)
}

/// By how much the rays of a wand miss each other, the mean over its LEDs, pixels.
fn misses(motion: &Pose, views: &[&WandView; 2], focal: f64) -> f64 {
    let [Some(a), Some(b)] = views.map(|view| view.lone) else { return f64::INFINITY };
    let miss = |i: usize| {
        let (ray, other) = (motion.rotation * a.rays[i], b.rays[i]);
        // The angle between one camera's ray and the plane of the base line and the other's ray, the lesser way round.
        let off = |ray: DVec3, other: DVec3| other.dot(motion.translation.cross(ray).normalize_or_zero()).abs();
        focal * off(ray, other).max(off(other, ray))
    };
    (miss(0) + miss(1) + miss(2)) / 3.0
}

/// Adjusts the two cameras and their wands.
fn refine(
    stick: &Stick,
    lenses: [&Intrinsics; 2],
    views: &[[&WandView; 2]],
    motion: Pose,
) -> Result<Option<Pair>, BundleError> {
    let mut bundle = Bundle::default();
    for (camera, intrinsics) in lenses.into_iter().enumerate() {
        bundle.cameras.push(BundleCamera {
            name: camera.to_string(),
            intrinsics: *intrinsics,
            pose: if camera == 0 { Pose::IDENTITY } else { motion },
            time_offset_s: 0.0,
            free: if camera == 0 { Vec::new() } else { Parameter::POSE.to_vec() },
        });
    }
    for views in views {
        let seen = [(0, views[0]), (1, views[1])];
        place::add(&mut bundle, stick, &seen, |_, _| (1.0, glam::DVec2::ZERO));
    }
    if bundle.placements.is_empty() {
        return Ok(None);
    }
    for (width, iterations) in [(20.0, 10), (3.0, 25)] {
        let options = Options { loss: Loss::Cauchy(width), iterations, tolerance: 1e-4, ..Options::default() };
        bundle.solve(&options)?;
    }
    let mut agree = vec![true; bundle.placements.len()];
    for observation in &bundle.observations {
        let limit = AGREES * lenses[observation.camera].fx;
        let near = bundle.residual_px(observation).is_some_and(|residual| residual.length() < limit);
        agree[observation.placement] &= near;
    }
    let count = agree.iter().filter(|agrees| **agrees).count();
    let agreeing = count as f64 / views.len() as f64;
    Ok(Some(Pair { motion: bundle.cameras[1].pose, agreeing, count }))
}
