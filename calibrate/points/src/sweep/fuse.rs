//! Points from depth maps that agree.

use std::{cmp::Reverse, collections::HashSet};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{SweepView, depth::DepthMap};
use crate::{
    CloudPoint, SweepOptions,
    photo::{Photo, median_colour},
};

/// A confirming depth may score this much less than the confirmed.
const LENIENCY: f32 = 0.1;
/// A view that sees this many tolerances past a point denies it.
const DENIAL: f64 = 3.0;

/// A point that several depth maps agree on.
struct Candidate {
    point: CloudPoint,
    score: f32,
}

/// What another view says about a point.
enum Opinion {
    Silent,
    /// It has a point at the same place, and sees it at a position of its photo.
    Agrees(DVec3),
    /// It sees something far behind.
    Denies,
}

/// The points on which enough depth maps agree, one for each voxel, best first. Positions are means over the views that
/// agree.
pub fn fuse(
    views: &[SweepView<'_>],
    photos: &[Photo],
    maps: &[DepthMap],
    t_ns: i64,
    options: &SweepOptions,
) -> Vec<CloudPoint> {
    let mut candidates: Vec<Candidate> = (0..views.len())
        .into_par_iter()
        .flat_map_iter(|view| {
            let map = &maps[view];
            (0..map.score.len())
                .filter(move |&pixel| map.score[pixel] >= options.min_score as f32)
                .filter_map(move |pixel| candidate(views, photos, maps, view, pixel, t_ns, options))
        })
        .collect();
    candidates.sort_by(|a, b| {
        (Reverse(a.point.track), b.score)
            .partial_cmp(&(Reverse(b.point.track), a.score))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    let mut taken = HashSet::with_capacity(candidates.len());
    candidates
        .into_iter()
        .map(|candidate| candidate.point)
        .filter(|point| taken.insert((point.position / options.voxel_m).floor().as_i64vec3()))
        .collect()
}

fn candidate(
    views: &[SweepView<'_>],
    photos: &[Photo],
    maps: &[DepthMap],
    view: usize,
    pixel: usize,
    t_ns: i64,
    options: &SweepOptions,
) -> Option<Candidate> {
    let own = unproject(&views[view], &maps[view], pixel);
    let (mut sum, mut agree, mut deny) = (own, 1, 0);
    let mut seen_by = Vec::with_capacity(8);
    for (other, map) in maps.iter().enumerate().filter(|&(other, _)| other != view) {
        match opinion(&views[other], map, own, options) {
            Opinion::Agrees(theirs) => {
                sum += theirs;
                agree += 1;
                seen_by.push(other);
            }
            Opinion::Denies => deny += 1,
            Opinion::Silent => {}
        }
    }
    if agree <= options.min_consistent || deny >= agree {
        return None;
    }
    let position = sum / f64::from(agree);
    let colours: Vec<[u8; 3]> = std::iter::once(view)
        .chain(seen_by)
        .filter_map(|index| Some(photos[index].colour(views[index].station.see(position)?.0)))
        .collect();
    let station = views[view].station;
    let at = station.see(position)?.0;
    let error = at.distance(full_resolution(&views[view], pixel_centre(&maps[view], pixel)));
    Some(Candidate {
        point: CloudPoint {
            position,
            colour: median_colour(&colours),
            track: agree,
            reprojection_error_px: error as f32,
            t_ns,
            instants: 1,
            moving: false,
        },
        score: maps[view].score[pixel],
    })
}

fn opinion(view: &SweepView<'_>, map: &DepthMap, point: DVec3, options: &SweepOptions) -> Opinion {
    let seen = view.station.pose().transform(point);
    if seen.z <= 1e-9 {
        return Opinion::Silent;
    }
    let at = view.intrinsics.project_pinhole(seen).floor();
    if !(at.x >= 0.0 && at.y >= 0.0 && at.x < map.width as f64 && at.y < map.height as f64) {
        return Opinion::Silent;
    }
    let pixel = at.y as usize * map.width + at.x as usize;
    let score = map.score[pixel];
    let ratio = 1.0 / (f64::from(map.inverse[pixel]) * seen.z);
    if score >= options.min_score as f32 - LENIENCY && (ratio - 1.0).abs() < options.depth_tolerance {
        Opinion::Agrees(unproject(view, map, pixel))
    } else if score >= options.min_score as f32 && ratio > 1.0 + DENIAL * options.depth_tolerance {
        Opinion::Denies
    } else {
        Opinion::Silent
    }
}

fn pixel_centre(map: &DepthMap, pixel: usize) -> DVec2 {
    DVec2::new((pixel % map.width) as f64 + 0.5, (pixel / map.width) as f64 + 0.5)
}

fn full_resolution(view: &SweepView<'_>, pixel: DVec2) -> DVec2 {
    let full = view.station.intrinsics();
    pixel
        * DVec2::new(
            f64::from(full.width) / f64::from(view.intrinsics.width),
            f64::from(full.height) / f64::from(view.intrinsics.height),
        )
}

fn unproject(view: &SweepView<'_>, map: &DepthMap, pixel: usize) -> DVec3 {
    let depth = 1.0 / f64::from(map.inverse[pixel]);
    view.station.pose().inverse().transform(view.intrinsics.unproject_pinhole(pixel_centre(map, pixel), depth))
}
