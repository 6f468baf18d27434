//! Lengths of wands that took no part, measured with the solution.

use glam::{DMat3, DVec3};

use super::{Stick, instants::Instant};
use crate::{bundle::BundleCamera, evidence::HeldOut, geometry::triangulate};

/// A view that lies farther from a triangulated LED, in standard deviations, is left out.
const LIMIT: f64 = 5.0;
/// A LED less certain than this in some direction is not measured, metres.
const COARSE_M: f64 = 0.02;

/// The gaps of the wands of `instants`, each LED triangulated on its own. `sigma_px` is that of each camera.
pub(super) fn lengths(
    stick: &Stick,
    cameras: &[BundleCamera],
    sigma_px: &[f64],
    instants: &[&Instant],
) -> Vec<HeldOut> {
    let mut lengths = Vec::new();
    let cameras: Vec<Option<BundleCamera>> = cameras.iter().cloned().map(Some).collect();
    for instant in instants {
        let points: [Option<DVec3>; 3] = std::array::from_fn(|led| {
            let (point, covariance) = locate(&cameras, sigma_px, instant, led)?;
            let variance = covariance.col(0).x + covariance.col(1).y + covariance.col(2).z;
            (variance.sqrt() < COARSE_M).then_some(point)
        });
        let gaps = [("first gap", 0, 1), ("second gap", 1, 2), ("whole wand", 0, 2)];
        let known = [stick.gaps_m()[0], stick.gaps_m()[1], stick.length_m()];
        for ((what, from, to), known_m) in gaps.into_iter().zip(known) {
            if let (Some(from), Some(to)) = (points[from], points[to]) {
                lengths.push(HeldOut { what: what.into(), known_m, found_m: (from - to).length() });
            }
        }
    }
    lengths
}

/// A LED by the cameras that are there, and its covariance.
pub(super) fn locate(
    cameras: &[Option<BundleCamera>],
    sigma_px: &[f64],
    instant: &Instant,
    led: usize,
) -> Option<(DVec3, DMat3)> {
    let mut views: Vec<_> = instant
        .views
        .iter()
        .filter_map(|view| {
            let (camera, seen) = (cameras[view.camera].as_ref()?, view.leds[led]?);
            let pixel = seen.pixel - seen.velocity * camera.time_offset_s;
            Some((&camera.intrinsics, &camera.pose, pixel, sigma_px[view.camera].hypot(seen.extra_px)))
        })
        .collect();
    loop {
        let (point, covariance) = triangulate(&views)?;
        let off = |&(lens, pose, pixel, sigma): &(&erfgs_scene::Intrinsics, &erfgs_scene::Pose, glam::DVec2, f64)| {
            lens.project(pose.transform(point)).map_or(f64::INFINITY, |seen| (seen - pixel).length() / sigma)
        };
        let worst = (0..views.len()).max_by(|&a, &b| off(&views[a]).total_cmp(&off(&views[b])))?;
        if off(&views[worst]) <= LIMIT {
            return Some((point, covariance));
        }
        views.swap_remove(worst);
    }
}

/// Mean and root mean square of the errors of the lengths called `what`, millimetres, and their number.
#[must_use]
pub(super) fn errors_mm(lengths: &[HeldOut], what: &str) -> Option<(f64, f64, usize)> {
    let errors =
        lengths.iter().filter(|length| length.what == what).map(|length| 1e3 * (length.found_m - length.known_m));
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0);
    for error in errors {
        sum += error;
        squares += error * error;
        count += 1;
    }
    (count > 0).then(|| (sum / count as f64, (squares / count as f64).sqrt(), count))
}
