//! Where a wand is, from the cameras that see it and whose poses are about known.

use glam::{DVec2, DVec3};

use super::{
    Stick,
    instants::{Led, WandView},
};
use crate::{
    bundle::{Bundle, BundleCamera, Observation, Placement},
    geometry::{Ray, nearest_point},
};

/// A residual of this many pixels costs half of what an outlier does.
const HALF_PX: f64 = 10.0;
/// About so many pairs of views are tried, spread over all.
const PAIRS: usize = 20;

/// Adds a wand to a bundle, with what its views saw of it; nothing where no place fits. `weigh` gives a LED's standard deviation
/// (pixels) and velocity (pixels per second) in a camera.
pub(super) fn add(
    bundle: &mut Bundle,
    stick: &Stick,
    views: &[(usize, &WandView)],
    weigh: impl Fn(usize, &Led) -> (f64, DVec2),
) {
    let Some(held) = placement(stick, &bundle.cameras, views) else { return };
    let placement = bundle.placements.len();
    bundle.placements.push(held);
    for &(camera, view) in views {
        for (led, offset) in view.leds.iter().zip(stick.offsets_m()) {
            let Some(led) = led else { continue };
            let (sigma_px, velocity) = weigh(camera, led);
            let (on_target, pixel) = (DVec3::new(offset, 0.0, 0.0), led.pixel);
            bundle.observations.push(Observation {
                camera,
                placement,
                on_target,
                side: None,
                pixel,
                sigma_px,
                velocity,
                used: true,
            });
        }
    }
}

/// The wand that most of the views agree with, in the world of the cameras; `None` where nothing fits. The views come with
/// the index of their camera.
///
/// Candidates are the wand of each view alone, and of each two views their triangulated LEDs; one outlier, or a camera
/// that took the wand for its mirror image, spoils only its own candidates.
pub(super) fn placement(stick: &Stick, cameras: &[BundleCamera], views: &[(usize, &WandView)]) -> Option<Placement> {
    let lone = views.iter().filter_map(|(camera, view)| {
        let to_world = cameras[*camera].pose.inverse();
        view.lone.map(|lone| lone.points.map(|point| to_world.transform(point)))
    });
    let count = views.len() * views.len().saturating_sub(1) / 2;
    let pairs = (0..views.len()).flat_map(|a| (a + 1..views.len()).map(move |b| [views[a], views[b]]));
    let pairs = pairs.step_by((count / PAIRS).max(1));
    let triangulated = pairs.filter_map(|[(a, first), (b, second)]| {
        let mut points = [DVec3::ZERO; 3];
        for (led, point) in points.iter_mut().enumerate() {
            let ray = |camera: usize, view: &WandView| {
                Ray::of_pixel(&cameras[camera].intrinsics, &cameras[camera].pose, view.leds[led]?.pixel)
            };
            *point = nearest_point(&[ray(a, first)?, ray(b, second)?])?;
        }
        Some(points)
    });
    let candidates = lone.chain(triangulated).filter_map(|points| fit(stick, points));
    let mut best = None;
    let mut least = f64::INFINITY;
    for placement in candidates {
        let cost = cost(stick, cameras, views, &placement, least);
        if cost < least {
            (least, best) = (cost, Some(placement));
        }
    }
    best
}

/// The wand nearest to three points.
fn fit(stick: &Stick, points: [DVec3; 3]) -> Option<Placement> {
    let mean = points.iter().sum::<DVec3>() / 3.0;
    let offsets = stick.offsets_m();
    let shift = offsets.iter().sum::<f64>() / 3.0;
    let along: DVec3 = points.iter().zip(offsets).map(|(point, offset)| (*point - mean) * (offset - shift)).sum();
    let direction = along.try_normalize()?;
    let middle = mean - direction * shift;
    middle.is_finite().then_some(Placement::Wand { middle, direction })
}

/// What a wand costs; something that is not less than `least` where it cannot be.
fn cost(
    stick: &Stick,
    cameras: &[BundleCamera],
    views: &[(usize, &WandView)],
    placement: &Placement,
    least: f64,
) -> f64 {
    let mut cost = 0.0;
    for (camera, view) in views {
        if cost >= least {
            break;
        }
        let camera = &cameras[*camera];
        for (led, offset) in view.leds.iter().zip(stick.offsets_m()) {
            let Some(led) = led else { continue };
            let world = placement.world(DVec3::new(offset, 0.0, 0.0));
            let squared = camera
                .intrinsics
                .project(camera.pose.transform(world))
                .map_or(f64::INFINITY, |pixel| (pixel - led.pixel).length_squared() / (HALF_PX * HALF_PX));
            cost += if squared.is_finite() { squared / (1.0 + squared) } else { 1.0 };
        }
    }
    cost
}
