//! Placing a camera against points that are there already.

use erfgs_scene::Intrinsics;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{run::Placed, tracks::Track};
use crate::{
    colmap::{brute::Descriptors, database::Keypoints},
    geometry::resection::{Resection, resect},
};

/// Ratio and angle of descriptors, as in the runs.
const RATIO: f64 = 0.85;
const MAX_DESCRIPTOR_ANGLE: f64 = 0.7;
/// Points within so many pixels bear a pose out.
const LIMIT_PX: f64 = 3.0;

/// Points, and the features of the placed views that they were seen as.
pub(super) struct Known<'a> {
    positions: Vec<DVec3>,
    /// For each placed view: its descriptors, and the point of each.
    views: Vec<(Descriptors, Vec<u32>)>,
    tracks: &'a [Track],
}

/// A camera's place, and from how many different points it was found.
#[derive(Clone, Debug)]
pub(super) struct Resected {
    pub placed: Placed,
    /// Correspondences that were tried.
    pub tried: usize,
    pub rms_px: f64,
    /// Those that bear it out: points and where they are seen.
    pub seen: Vec<(DVec3, DVec2)>,
}

impl<'a> Known<'a> {
    /// Of tracks, and the features that they index.
    pub fn new(tracks: &'a [Track], features: &[Keypoints]) -> Self {
        let mut members: Vec<Vec<(u32, u32)>> = vec![Vec::new(); features.len()];
        for (point, track) in tracks.iter().enumerate() {
            for &(view, feature) in &track.seen {
                members[view].push((feature, point as u32));
            }
        }
        let views = members.par_iter().enumerate().filter(|(_, members)| !members.is_empty()).map(|(view, members)| {
            let descriptors: Vec<_> =
                members.iter().map(|(feature, _)| features[view].descriptors[*feature as usize]).collect();
            (Descriptors::new(&descriptors), members.iter().map(|(_, point)| *point).collect())
        });
        Self { positions: tracks.iter().map(|track| track.position).collect(), views: views.collect(), tracks }
    }

    /// Finds the camera that has these features.
    pub fn place(&self, intrinsics: &Intrinsics, features: &Keypoints, seed: u64) -> Option<Resected> {
        let own = Descriptors::new(&features.descriptors);
        let mut pairs: Vec<(u32, u32)> = self
            .views
            .par_iter()
            .flat_map_iter(|(descriptors, points)| {
                let matches = own.matches(descriptors, RATIO, MAX_DESCRIPTOR_ANGLE);
                matches.into_iter().map(move |[feature, index]| (feature, points[index as usize]))
            })
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let seen: Vec<(DVec3, DVec2)> = pairs
            .iter()
            .map(|&(feature, point)| (self.positions[point as usize], features.positions[feature as usize]))
            .collect();
        let found: Resection = resect(intrinsics, &seen, LIMIT_PX, seed)?;
        let mut points: Vec<u32> =
            pairs.iter().zip(&found.inliers).filter(|(_, inlier)| **inlier).map(|(pair, _)| pair.1).collect();
        points.sort_unstable();
        points.dedup();
        debug_assert!(points.len() <= self.tracks.len());
        let placed = Placed { intrinsics: *intrinsics, pose: found.pose, points: points.len() };
        let tried = seen.len();
        let seen = seen.into_iter().zip(&found.inliers).filter(|(_, inlier)| **inlier).map(|(seen, _)| seen).collect();
        Some(Resected { placed, tried, rms_px: found.rms_px, seen })
    }
}
