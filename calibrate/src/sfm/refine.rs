//! From poses that are nearly right to poses with covariances: matching along the epipolar lines finds many times more
//! points than COLMAP's matching without poses, and the bundle is adjusted to all of them.

use std::sync::atomic::{AtomicUsize, Ordering};

use erfgs_scene::{Distortion, Intrinsics};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{
    CameraView, Progress, SfmError, SfmStep,
    run::Placed,
    tracks::{PairMatches, Track, components, triangulate},
};
use crate::{
    bundle::{Bundle, BundleCamera, Loss, Observation, Options, Parameter, Placement, Prior, Solution},
    colmap::{
        database::Keypoints,
        matching::{Features, Limits, Relative, match_pair},
    },
};

/// A pass of densification.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass {
    /// Width of the epipolar band, pixels.
    pub band_px: f64,
    /// What the pass is called in the report.
    pub name: &'static str,
}

/// What is free, and what lengths are tied to.
#[derive(Clone, Debug)]
pub(super) struct Gauge {
    /// The views whose poses stay.
    pub fixed: Vec<usize>,
    /// Two views, and how far apart they are.
    pub distance: Option<([usize; 2], f64)>,
}

/// A bundle of points, and the view that each of its cameras is.
pub(super) struct Adjusted {
    pub bundle: Bundle,
    pub views: Vec<usize>,
    /// What the placements are made of; their positions are from before the adjustment.
    tracks: Vec<Track>,
    pub solutions: Vec<(String, Solution)>,
}

/// Fewest views of a point; of those with two, half are wrong.
pub(super) const FEWEST_VIEWS: usize = 3;
/// Ratio of descriptor angles.
const RATIO: f64 = 0.85;
/// Greatest angle between rays, degrees: SIFT does not survive more.
const MAX_RAY_ANGLE_DEG: f64 = 40.0;
/// Descriptor angle beyond which nothing matches, radians.
const MAX_DESCRIPTOR_ANGLE: f64 = 0.7;
/// Standard deviation of an unknown principal point from the middle of the image, as share of its longer side.
const PRINCIPAL_POINT: f64 = 0.02;
/// Standard deviation of an unknown first coefficient of the lens.
const DISTORTION: f64 = 0.02;

/// Matches all pairs of placed views along their epipolar lines.
pub(super) fn matches(
    cameras: &[Option<Placed>],
    features: &[Keypoints],
    depths: [f64; 2],
    pass: &Pass,
    progress: Progress<'_>,
) -> Vec<PairMatches> {
    let ideal: Vec<Option<(Intrinsics, Features)>> = cameras
        .iter()
        .zip(features)
        .map(|(camera, keypoints)| Some(undistorted(&camera.as_ref()?.intrinsics, keypoints)))
        .collect();
    let placed: Vec<usize> = (0..cameras.len()).filter(|&view| cameras[view].is_some()).collect();
    let pairs: Vec<(usize, usize)> =
        placed.iter().enumerate().flat_map(|(i, &a)| placed[i + 1..].iter().map(move |&b| (a, b))).collect();
    let limits = Limits {
        band_px: pass.band_px,
        ratio: RATIO,
        max_descriptor_angle: MAX_DESCRIPTOR_ANGLE,
        max_ray_angle: MAX_RAY_ANGLE_DEG.to_radians(),
        depth_m: depths,
    };
    let done = AtomicUsize::new(0);
    pairs
        .par_iter()
        .filter_map(|&(a, b)| {
            let ((ka, fa), (kb, fb)) = (ideal[a].as_ref()?, ideal[b].as_ref()?);
            let (ca, cb) = ((ka, &cameras[a].as_ref()?.pose), (kb, &cameras[b].as_ref()?.pose));
            let relative = Relative::new(ca, cb);
            let matches = match_pair(fa, ca, fb, cb, &relative, &limits);
            progress(SfmStep::Refining, done.fetch_add(1, Ordering::Relaxed) + 1, pairs.len());
            Some(((a, b), matches))
        })
        .collect()
}

/// Features where a lens without distortion would have them. What the lens model cannot invert goes far outside.
fn undistorted(k: &Intrinsics, keypoints: &Keypoints) -> (Intrinsics, Features) {
    let pinhole = Intrinsics { distortion: Distortion::None, ..*k };
    let ideal = |&pixel: &DVec2| match k.distortion {
        Distortion::None => pixel,
        _ => match k.unproject(pixel) {
            Ok(ray) if ray.z > 1e-6 => pinhole.project_pinhole(ray),
            _ => DVec2::splat(-1e6),
        },
    };
    let points = keypoints.positions.iter().map(ideal).collect();
    (pinhole, Features::new(k.width, k.height, points, keypoints.descriptors.clone()))
}

/// Matches and triangulates.
pub(super) fn tracks(
    cameras: &[Option<Placed>],
    features: &[Keypoints],
    depths: [f64; 2],
    pass: &Pass,
    progress: Progress<'_>,
) -> Vec<Track> {
    let found = matches(cameras, features, depths, pass, progress);
    let joined = components(features, &found, FEWEST_VIEWS);
    triangulate(features, cameras, &joined, FEWEST_VIEWS, 2.0 * pass.band_px)
}

/// Adjusts cameras and points: first with a loss that outliers cannot pull, then without them and with the standard
/// deviations that the residuals show.
pub(super) fn adjust(
    views: &[CameraView],
    cameras: &[Option<Placed>],
    features: &[Keypoints],
    tracks: Vec<Track>,
    gauge: &Gauge,
) -> Result<Adjusted, SfmError> {
    let placed: Vec<usize> = (0..views.len()).filter(|&view| cameras[view].is_some()).collect();
    let index_of = |view: usize| placed.iter().position(|&placed| placed == view);
    let mut bundle = Bundle::default();
    for &view in &placed {
        let Some(camera) = &cameras[view] else { continue };
        let index = bundle.cameras.len();
        let mut free = Vec::new();
        let mut intrinsics = camera.intrinsics;
        if views[view].intrinsics.is_none() {
            free.extend([Parameter::Focal, Parameter::Cx, Parameter::Cy, Parameter::Coefficient(0)]);
            if intrinsics.distortion == Distortion::None {
                intrinsics.distortion = Distortion::BrownConrady([0.0; 8]);
            }
            let [w, h] = [intrinsics.width, intrinsics.height].map(f64::from);
            let priors = [
                (Parameter::Cx, 0.5 * w, PRINCIPAL_POINT * w.max(h)),
                (Parameter::Cy, 0.5 * h, PRINCIPAL_POINT * w.max(h)),
                (Parameter::Coefficient(0), 0.0, DISTORTION),
            ];
            for (parameter, value, sigma) in priors {
                bundle.priors.push(Prior::Value { camera: index, parameter, value, sigma });
            }
        }
        if !gauge.fixed.contains(&view) {
            free.extend(Parameter::POSE);
        }
        bundle.cameras.push(BundleCamera {
            name: views[view].name.clone(),
            intrinsics,
            pose: camera.pose,
            time_offset_s: 0.0,
            free,
        });
    }
    if let Some((ends, metres)) = gauge.distance
        && let (Some(a), Some(b)) = (index_of(ends[0]), index_of(ends[1]))
    {
        bundle.priors.push(Prior::Distance { cameras: [a, b], metres, sigma: 1e-6 * metres });
    }
    for track in &tracks {
        let placement = bundle.placements.len();
        bundle.placements.push(Placement::Point(track.position));
        for &(view, feature) in &track.seen {
            let Some(camera) = index_of(view) else { continue };
            bundle.observations.push(Observation {
                camera,
                placement,
                on_target: DVec3::ZERO,
                side: None,
                pixel: features[view].positions[feature as usize],
                sigma_px: BASE_SIGMA * features[view].scales[feature as usize].max(0.5).powf(SIGMA_POWER),
                velocity: DVec2::ZERO,
                used: true,
            });
        }
    }
    let mut solutions = Vec::new();
    let robust = Options { loss: Loss::Cauchy(2.0), iterations: 30, tolerance: 1e-6, ..Options::default() };
    solutions.push(("robust".into(), bundle.solve(&robust)?));
    rescale(&mut bundle);
    outliers(&mut bundle);
    solutions.push(("robust again".into(), bundle.solve(&robust)?));
    rescale(&mut bundle);
    outliers(&mut bundle);
    let squared = Options { iterations: 30, tolerance: 1e-9, ..Options::default() };
    solutions.push(("without outliers".into(), bundle.solve(&squared)?));
    Ok(Adjusted { bundle, views: placed, tracks, solutions })
}

/// Standard deviation of a feature of scale 1 px before the residuals tell.
const BASE_SIGMA: f64 = 0.3;
/// How it grows with the scale.
const SIGMA_POWER: f64 = 0.5;
/// Residuals beyond so many standard deviations are outliers.
const OUTLIER: f64 = 3.5;

/// Multiplies all standard deviations so that the median residual is what it should be.
fn rescale(bundle: &mut Bundle) {
    let mut ratios: Vec<f64> = bundle
        .observations
        .iter()
        .filter_map(|o| Some(bundle.residual_px(o)?.length() / o.sigma_px))
        .filter(|ratio| ratio.is_finite())
        .collect();
    if ratios.is_empty() {
        return;
    }
    let middle = ratios.len() / 2;
    let median = *ratios.select_nth_unstable_by(middle, f64::total_cmp).1;
    // The median of a Rayleigh distribution is sqrt(2 ln 2).
    let factor = (median / (2.0 * std::f64::consts::LN_2).sqrt()).max(1e-3);
    for observation in &mut bundle.observations {
        observation.sigma_px *= factor;
    }
}

/// Marks outliers, and with them all observations of points that fewer than three others hold.
fn outliers(bundle: &mut Bundle) {
    bundle.mark_outliers(OUTLIER, 0.0);
    let mut seen = vec![0usize; bundle.placements.len()];
    for observation in bundle.observations.iter().filter(|o| o.used) {
        seen[observation.placement] += 1;
    }
    for observation in &mut bundle.observations {
        observation.used &= seen[observation.placement] >= FEWEST_VIEWS;
    }
}

impl Adjusted {
    /// The cameras as adjusted, by view; `views` is their number.
    pub fn cameras(&self, views: usize) -> Vec<Option<Placed>> {
        let mut cameras = vec![None; views];
        for (index, (&view, camera)) in self.views.iter().zip(&self.bundle.cameras).enumerate() {
            let points = self.bundle.observations.iter().filter(|o| o.camera == index && o.used).count();
            cameras[view] = Some(Placed { intrinsics: camera.intrinsics, pose: camera.pose, points });
        }
        cameras
    }

    /// The points as adjusted, with the observations that took part.
    pub fn points(&self) -> Vec<Track> {
        let mut tracks: Vec<Track> = Vec::new();
        let mut next = 0;
        for (placement, track) in self.tracks.iter().enumerate() {
            // Observations lie in the order of the tracks, less those of views that have no camera.
            let mut seen = Vec::new();
            for &(view, feature) in &track.seen {
                if !self.views.contains(&view) {
                    continue;
                }
                if self.bundle.observations[next].used {
                    seen.push((view, feature));
                }
                next += 1;
            }
            if seen.len() >= FEWEST_VIEWS {
                let position = self.bundle.placements[placement].world(DVec3::ZERO);
                tracks.push(Track { position, seen });
            }
        }
        tracks
    }

    /// Depths at which points are seen, with room: half the 2nd percentile to one and a half times the 98th.
    pub fn depths(&self) -> Option<[f64; 2]> {
        let used = self.bundle.observations.iter().filter(|o| o.used);
        let depth = |o: &Observation| {
            let world = self.bundle.placements[o.placement].world(o.on_target);
            self.bundle.cameras[o.camera].pose.transform(world).z
        };
        let mut depths: Vec<f64> = used.map(depth).filter(|depth| *depth > 0.0).collect();
        depths.sort_by(f64::total_cmp);
        let at = |share: f64| depths.get((depths.len().saturating_sub(1) as f64 * share) as usize).copied();
        Some([0.5 * at(0.02)?, 1.5 * at(0.98)?])
    }

    /// For each camera of the bundle: with how many others it shares at least ten points.
    pub fn neighbours(&self) -> Vec<usize> {
        let count = self.views.len();
        let mut by_point: Vec<Vec<usize>> = vec![Vec::new(); self.bundle.placements.len()];
        for observation in self.bundle.observations.iter().filter(|o| o.used) {
            by_point[observation.placement].push(observation.camera);
        }
        let mut shared = vec![0usize; count * count];
        for cameras in &by_point {
            for &a in cameras {
                for &b in cameras {
                    shared[a * count + b] += 1;
                }
            }
        }
        (0..count).map(|a| (0..count).filter(|&b| a != b && shared[a * count + b] >= 10).count()).collect()
    }
}
