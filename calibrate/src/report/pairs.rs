//! Pairs of cameras that saw the same, and how far what one saw lies from the other's epipolar lines.

use std::collections::{BTreeMap, BTreeSet};

use erfgs_scene::Modality;
use glam::DVec2;

use crate::{
    evidence::{Evidence, Picture},
    geometry::EpipolarCurve,
};
use erfgs_scene::rig_file::RigFile;

/// Two cameras that share fewer features are no neighbours.
const LEAST: usize = 6;
/// Features of one instant that are worth a picture.
const LEAST_AT_ONCE: usize = 3;

/// A feature that two cameras saw, at the placement's instant, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shared {
    pub placement: usize,
    pub first: DVec2,
    pub second: DVec2,
}

/// Two cameras that saw the same features; the lines of the first one's points are looked at in the second.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pair {
    pub first: usize,
    pub second: usize,
    pub shared: Vec<Shared>,
    /// Distances of the second camera's points from the lines, pixels, in order.
    pub distances: Vec<f64>,
    /// The placement whose pictures are shown; `None` where there is no picture, or all are of one instant.
    pub placement: Option<usize>,
}

/// For each camera the pair with its best neighbour: one of the other kind before one of its own, one with a picture of the
/// same instant before others, then the one with which it shares most. RGB and event cameras first.
pub(super) fn pairs(rig: &RigFile, evidence: &Evidence) -> Vec<Pair> {
    let features = features(rig, evidence);
    let count = rig.cameras.len();
    let mut shared = vec![0usize; count * count];
    for cameras in features.values() {
        for (a, _) in cameras {
            for (b, _) in cameras {
                shared[a * count + b] += 1;
            }
        }
    }
    let mixed = |a: usize, b: usize| {
        let kinds = [rig.cameras[a].modality, rig.cameras[b].modality];
        kinds.contains(&Modality::Rgb) && kinds.contains(&Modality::Event)
    };
    let together = |a: usize, b: usize| {
        let (a, b) = (picture(evidence, a), picture(evidence, b));
        a.zip(b).is_some_and(|(a, b)| a.placement == b.placement)
    };
    let mut chosen: BTreeSet<(bool, usize, usize)> = BTreeSet::new();
    for a in 0..count {
        let others = (0..count).filter(|&b| b != a && shared[a * count + b] >= LEAST);
        let best = others.max_by_key(|&b| (mixed(a, b), together(a, b), shared[a * count + b], std::cmp::Reverse(b)));
        let Some(b) = best else { continue };
        // RGB on events: the lines are drawn where the events are.
        let events = |camera: usize| rig.cameras[camera].modality == Modality::Event;
        let (first, second) = if (events(a), a) < (events(b), b) { (a, b) } else { (b, a) };
        chosen.insert((!mixed(a, b), first, second));
    }
    chosen.into_iter().map(|(_, first, second)| pair(rig, evidence, &features, first, second)).collect()
}

/// The camera's picture.
pub(super) fn picture(evidence: &Evidence, camera: usize) -> Option<&Picture> {
    evidence.pictures.iter().find(|picture| picture.camera == camera)
}

/// What tells a feature: its placement, the side of that, and where it is there.
type Feature = (usize, Option<usize>, [u64; 3]);

/// Who saw each feature that took part, and where.
fn features(rig: &RigFile, evidence: &Evidence) -> BTreeMap<Feature, Vec<(usize, DVec2)>> {
    let mut features: BTreeMap<Feature, Vec<(usize, DVec2)>> = BTreeMap::new();
    for residual in evidence.residuals.iter().filter(|residual| residual.used) {
        if rig.cameras.get(residual.camera).is_none_or(|camera| camera.pose.is_none()) {
            continue;
        }
        let feature = (residual.placement, residual.side, residual.on_target.to_array().map(f64::to_bits));
        let cameras = features.entry(feature).or_default();
        if !cameras.iter().any(|(camera, _)| *camera == residual.camera) {
            cameras.push((residual.camera, residual.at_instant));
        }
    }
    features
}

fn pair(
    rig: &RigFile,
    evidence: &Evidence,
    features: &BTreeMap<Feature, Vec<(usize, DVec2)>>,
    first: usize,
    second: usize,
) -> Pair {
    let shared: Vec<Shared> = features
        .iter()
        .filter_map(|((placement, ..), cameras)| {
            let of = |camera: usize| cameras.iter().find(|(other, _)| *other == camera).map(|(_, pixel)| *pixel);
            Some(Shared { placement: *placement, first: of(first)?, second: of(second)? })
        })
        .collect();
    let mut distances: Vec<f64> = shared
        .iter()
        .filter_map(|shared| curve(rig, first, second, shared.first)?.distance_px(shared.second))
        .filter(|distance| distance.is_finite())
        .collect();
    distances.sort_by(f64::total_cmp);
    // The instant of the second one's picture, where the first saw it too; else that of the first one's.
    let shown = [second, first].into_iter().filter_map(|camera| picture(evidence, camera)?.placement);
    let enough = |placement: &usize| shared.iter().filter(|s| s.placement == *placement).count() >= LEAST_AT_ONCE;
    let placement = shown.into_iter().find(enough);
    Pair { first, second, shared, distances, placement }
}

/// The line in `second` of a point of `first`.
pub(super) fn curve(rig: &RigFile, first: usize, second: usize, pixel: DVec2) -> Option<EpipolarCurve> {
    let (from, to) = (rig.cameras.get(first)?, rig.cameras.get(second)?);
    EpipolarCurve::new((&from.intrinsics, from.pose.as_ref()?), pixel, (&to.intrinsics, to.pose.as_ref()?))
}

impl Pair {
    /// The distance that `share` of the points do not exceed, pixels.
    pub fn quantile(&self, share: f64) -> Option<f64> {
        let last = self.distances.len().checked_sub(1)?;
        self.distances.get((last as f64 * share).round() as usize).copied()
    }

    /// At most `most` of the features that are shown, far from each other in both images; `sizes` are those of the images.
    pub fn spread(&self, most: usize, sizes: [DVec2; 2]) -> Vec<Shared> {
        let shown: Vec<Shared> =
            self.shared.iter().filter(|s| self.placement.is_none_or(|p| p == s.placement)).copied().collect();
        let apart = |a: &Shared, b: &Shared| {
            ((a.first - b.first) / sizes[0]).length() + ((a.second - b.second) / sizes[1]).length()
        };
        let mut chosen: Vec<Shared> = shown.first().copied().into_iter().collect();
        let mut nearest: Vec<f64> = shown.iter().map(|s| chosen.first().map_or(0.0, |c| apart(s, c))).collect();
        while chosen.len() < most.min(shown.len()) {
            let farthest = (0..shown.len()).max_by(|&a, &b| nearest[a].total_cmp(&nearest[b]));
            let Some(next) = farthest.filter(|&index| nearest[index] > 0.0).map(|index| shown[index]) else { break };
            chosen.push(next);
            nearest.iter_mut().zip(&shown).for_each(|(least, s)| *least = least.min(apart(s, &next)));
        }
        chosen
    }
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, ImageRgb8, Intrinsics, Pose};
    use glam::DVec3;

    use super::*;
    use crate::{evidence::Residual, report::page};
    use erfgs_scene::rig_file::RigCamera;

    /// Two RGB cameras and two event cameras, each with a lens of its own; the last one sees little.
    fn rig() -> RigFile {
        let lenses = [
            Distortion::None,
            Distortion::BrownConrady([-0.2, 0.05, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]),
            Distortion::KannalaBrandt([0.03, 0.0, 0.0, 0.0]),
            Distortion::None,
        ];
        let eyes = [(-1.0, 0.1), (-0.5, -0.2), (0.5, 0.2), (1.0, 0.0)];
        let kinds = [Modality::Rgb, Modality::Rgb, Modality::Event, Modality::Event];
        let cameras = (0..4).map(|index| {
            let distortion = lenses[index];
            let intrinsics =
                Intrinsics { width: 640, height: 480, fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, distortion };
            let eye = DVec3::new(eyes[index].0, eyes[index].1, -2.0);
            RigCamera::new(
                &format!("cam{index}"),
                kinds[index],
                intrinsics,
                Some(Pose::look_at(eye, DVec3::ZERO, DVec3::Y)),
            )
        });
        RigFile::new("board", true, cameras.collect())
    }

    /// What they saw of two boards; the last camera of the first only, and from few corners.
    fn evidence(rig: &RigFile, off: DVec2) -> Evidence {
        let mut evidence = Evidence::default();
        for placement in 0..2 {
            for corner in 0..20 {
                let on_target = DVec3::new(f64::from(corner % 5), f64::from(corner / 5), 0.0) * 0.1;
                let point = on_target + DVec3::new(-0.2, -0.15, 0.3 * placement as f64);
                for (camera, known) in rig.cameras.iter().enumerate() {
                    if camera == 3 && (placement, corner > 6) != (0, false) {
                        continue;
                    }
                    let seen = known.intrinsics.project(known.pose.unwrap().transform(point)).unwrap();
                    let pixel = seen + if camera == 1 { off } else { DVec2::ZERO };
                    let residual = Some(DVec2::ZERO);
                    evidence.residuals.push(Residual {
                        camera,
                        placement,
                        on_target,
                        side: None,
                        pixel,
                        at_instant: pixel,
                        residual,
                        used: true,
                    });
                }
            }
        }
        evidence
    }

    #[test]
    fn each_camera_has_a_neighbour_of_the_other_kind_and_exact_points_lie_on_their_lines() {
        let rig = rig();
        let pairs = pairs(&rig, &evidence(&rig, DVec2::ZERO));
        let who: Vec<[usize; 2]> = pairs.iter().map(|pair| [pair.first, pair.second]).collect();
        // RGB first, and the lines where the events are; the camera that sees little comes in by its own best pair.
        assert_eq!(who, [[0, 2], [0, 3], [1, 2]]);
        assert_eq!(pairs.iter().map(|pair| pair.shared.len()).collect::<Vec<_>>(), [40, 7, 40]);
        for pair in &pairs {
            assert_eq!(pair.distances.len(), pair.shared.len());
            assert!(pair.quantile(1.0).unwrap() < 1e-6, "{:?}", pair.quantile(1.0));
        }
    }

    #[test]
    fn a_point_that_is_off_its_line_is_off_by_as_much() {
        let rig = rig();
        let pairs = pairs(&rig, &evidence(&rig, DVec2::new(0.0, 2.0)));
        // The cameras stand side by side: lines are about level.
        let median = pairs[2].quantile(0.5).unwrap();
        assert!((1.2..2.4).contains(&median), "{median}");
        assert!(pairs[0].quantile(1.0).unwrap() < 1e-6);
    }

    #[test]
    fn pictures_of_one_instant_decide_what_is_drawn_and_without_pictures_all_is() {
        let rig = rig();
        let mut evidence = evidence(&rig, DVec2::ZERO);
        let bare = pairs(&rig, &evidence);
        assert_eq!(bare[0].placement, None);
        let sizes = [DVec2::new(640.0, 480.0); 2];
        assert_eq!(bare[0].spread(8, sizes).len(), 8);
        let html = page(&rig, &evidence);
        assert!(html.contains("cam0 → cam2") && html.contains("RGB on events") && !html.contains("<use"));
        evidence.pictures = [0, 2].map(|camera| Picture::new(camera, Some(1), &ImageRgb8::new(640, 480))).to_vec();
        let pictured = pairs(&rig, &evidence);
        assert_eq!(pictured[0].placement, Some(1));
        assert!(pictured[0].spread(8, sizes).iter().all(|shared| shared.placement == 1));
        let html = page(&rig, &evidence);
        // The pair's pictures, and that of the pair of which only one was taken.
        assert!(
            html.contains("id=\"picture-2\"") && html.matches("<use").count() == 3,
            "{}",
            html.matches("<use").count()
        );
        assert!(!html.contains("NaN"));
    }
}
