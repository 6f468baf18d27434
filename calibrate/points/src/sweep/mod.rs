//! Dense points by plane sweep.
//!
//! Each view of an instant gets a depth map (`depth`): its neighbours are warped onto planes parallel to its image, and
//! each pixel takes the plane on which the neighbours look most like it. Pixels whose depth other depth maps confirm
//! become points (`fuse`).

mod depth;
mod fuse;
mod window;

use std::sync::atomic::{AtomicUsize, Ordering};

use erfgs_scene::{Intrinsics, image::Resample};
use rayon::prelude::*;

use self::depth::{DepthMap, Grey, depth_map};
use super::{
    CloudError, CloudOptions, CloudPoint, CloudStep, Counts, Progress,
    photo::Photo,
    rig::{Reach, Rig, Station, spread},
    thin::merge_instants,
};
use erfgs_calibrate::statistics::median;

/// Neighbours that see the focus at a greater angle look too different.
const WIDEST_DEG: f64 = 60.0;

/// Without a depth range, planes start at this share of the depth that the cameras look at: evenly spaced in inverse
/// depth, most would otherwise lie where there is nothing.
const NEAREST_OF_FOCUS: f64 = 0.3;
/// Most planes of a depth map.
const MOST_PLANES: f64 = 1024.0;

/// A view at the resolution that depth maps are made at.
#[derive(Clone, Debug)]
struct SweepView<'a> {
    station: &'a Station<'a>,
    intrinsics: Intrinsics,
    grey: Grey,
}

/// Which instants of `rig` are swept.
pub fn instants(rig: &Rig<'_>, options: &CloudOptions) -> Vec<usize> {
    spread(rig.instants.len(), options.sweep.instants as usize)
}

/// The points of the instants that [`instants`] names, best first within each.
pub fn points(
    rig: &Rig<'_>,
    photos: &[Vec<Photo>],
    options: &CloudOptions,
    reach: &Reach,
    progress: Progress<'_>,
    counts: &mut Counts,
) -> Result<Vec<CloudPoint>, CloudError> {
    check(options)?;
    let mut depth_m = reach.depth_m;
    if options.depth_m.is_none() && options.bounds_m.is_none() {
        depth_m[0] = depth_m[0].max(NEAREST_OF_FOCUS * reach.focus_m);
    }
    let chosen = instants(rig, options);
    let total = chosen.iter().map(|&instant| rig.instants[instant].shots.len()).sum();
    let done = AtomicUsize::new(0);
    let mut points = Vec::new();
    let mut candidates = 0;
    for &instant in &chosen {
        let photos = &photos[instant];
        let views = views(rig, instant, photos, options);
        progress(CloudStep::Sweep, done.load(Ordering::Relaxed), total);
        let maps: Vec<DepthMap> = (0..views.len())
            .into_par_iter()
            .map(|index| {
                let near = neighbours(&views, index, reach.focus_m, options.sweep.neighbours as usize);
                let near: Vec<&SweepView<'_>> = near.into_iter().map(|other| &views[other]).collect();
                let planes = planes(&views[index], &near, depth_m, options.sweep.plane_step_px);
                let map = depth_map(&views[index], &near, depth_m, planes, &options.sweep);
                progress(CloudStep::Sweep, done.fetch_add(1, Ordering::Relaxed) + 1, total);
                map
            })
            .collect();
        progress(CloudStep::Fusion, 0, 1);
        let fused = fuse::fuse(&views, photos, &maps, rig.instants[instant].t_ns, &options.sweep);
        candidates += maps.iter().map(|map| map.count(options.sweep.min_score as f32)).sum::<usize>();
        points.extend(fused);
        progress(CloudStep::Fusion, 1, 1);
    }
    counts.insert("sweep_candidates".into(), candidates.into());
    counts.insert("sweep_points".into(), points.len().into());
    if chosen.len() > 1 {
        points = merge_instants(points, options.sweep.voxel_m);
    }
    Ok(points)
}

fn check(options: &CloudOptions) -> Result<(), CloudError> {
    let wrong = |option, why: String| Err(CloudError::Option { option, why });
    let sweep = &options.sweep;
    if !(sweep.plane_step_px > 0.0 && sweep.plane_step_px.is_finite()) {
        return wrong("plane_step_px", format!("{} is no positive distance", sweep.plane_step_px));
    }
    if sweep.window.is_multiple_of(2) || !(3..=15).contains(&sweep.window) {
        return wrong("window", format!("{} is not one of 3, 5, ... 15", sweep.window));
    }
    if sweep.neighbours == 0 || sweep.instants == 0 {
        return wrong("neighbours, instants", "at least one is needed".into());
    }
    if sweep.max_width < 16 {
        return wrong("max_width", format!("{} pixels are too few", sweep.max_width));
    }
    if !(sweep.voxel_m > 0.0 && sweep.voxel_m.is_finite()) {
        return wrong("voxel_m", format!("{} is no positive size", sweep.voxel_m));
    }
    if !(sweep.depth_tolerance > 0.0 && sweep.depth_tolerance < 1.0) {
        return wrong("depth_tolerance", format!("{} is not in (0, 1)", sweep.depth_tolerance));
    }
    Ok(())
}

fn views<'a>(rig: &'a Rig<'_>, instant: usize, photos: &[Photo], options: &CloudOptions) -> Vec<SweepView<'a>> {
    let shots = &rig.instants[instant].shots;
    let make = |(&(station, _), photo): (&(usize, _), &Photo)| {
        let station = &rig.stations[station];
        let full = station.intrinsics();
        let factor = full.width.div_ceil(options.sweep.max_width).max(1);
        let (width, height) = ((full.width / factor).max(1), (full.height / factor).max(1));
        let grey = Grey::new(&photo.grey().resized(width, height, Resample::Area));
        SweepView { station, intrinsics: full.resized(width, height), grey }
    };
    shots.iter().zip(photos).map(make).collect()
}

/// How many planes make steps of `step_px` in the middle one of the neighbours.
fn planes(view: &SweepView<'_>, neighbours: &[&SweepView<'_>], [near, far]: [f64; 2], step_px: f64) -> u32 {
    let own = view.station.centre;
    let disparities = neighbours
        .iter()
        .map(|other| other.station.centre.distance(own) * other.intrinsics.fx.max(other.intrinsics.fy));
    let per_inverse_metre = median(disparities).unwrap_or(0.0);
    (per_inverse_metre * (1.0 / near - 1.0 / far) / step_px).clamp(8.0, MOST_PLANES) as u32
}

/// Up to `most` views that see what view `index` looks at from the nearest angles, nearest first.
fn neighbours(views: &[SweepView<'_>], index: usize, focus_m: f64, most: usize) -> Vec<usize> {
    let own = views[index].station;
    let target = own.centre + own.forward() * focus_m;
    let mut others: Vec<(f64, usize)> = views
        .iter()
        .enumerate()
        .filter(|&(other, view)| other != index && view.station.centre.distance(own.centre) > 1e-6 * focus_m)
        .map(|(other, view)| ((own.centre - target).angle_between(view.station.centre - target), other))
        .filter(|&(angle, _)| angle < WIDEST_DEG.to_radians())
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    others.into_iter().take(most).map(|(_, other)| other).collect()
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
