//! Which instants are shown: one for each camera, such that cameras are shown together where they saw the same.

use std::collections::BTreeMap;

use glam::DVec2;

use crate::evidence::Evidence;
use erfgs_scene::rig_file::RigFile;

/// A camera must have seen so many features of a placement to be shown with it.
const LEAST: usize = 3;

/// What a camera saw of a placement: how many features, and the box around them.
#[derive(Clone, Copy)]
struct Extent {
    count: usize,
    least: DVec2,
    most: DVec2,
}

/// For cameras that saw placements, the one that a picture of it should show: index of the camera, number of the placement. As
/// few different placements as will do, large in the images.
#[must_use]
pub fn telling(rig: &RigFile, evidence: &Evidence) -> Vec<(usize, usize)> {
    let mut seen: BTreeMap<usize, BTreeMap<usize, Extent>> = BTreeMap::new();
    for residual in evidence.residuals.iter().filter(|residual| residual.used && residual.camera < rig.cameras.len()) {
        let new = Extent { count: 0, least: residual.pixel, most: residual.pixel };
        let extent = seen.entry(residual.placement).or_default().entry(residual.camera).or_insert(new);
        extent.count += 1;
        extent.least = extent.least.min(residual.pixel);
        extent.most = extent.most.max(residual.pixel);
    }
    let share = |camera: usize, extent: &Extent| {
        let i = &rig.cameras[camera].intrinsics;
        let size = extent.most - extent.least;
        (size.x * size.y / (f64::from(i.width) * f64::from(i.height))).clamp(0.0, 1.0)
    };
    let mut chosen: BTreeMap<usize, usize> = BTreeMap::new();
    loop {
        let worth = seen.iter().map(|(placement, cameras)| {
            let open = cameras.iter().filter(|(camera, e)| e.count >= LEAST && !chosen.contains_key(camera));
            (*placement, open.map(|(camera, extent)| 1.0 + share(*camera, extent)).sum::<f64>())
        });
        // Of placements that are worth the same, the first.
        let best = worth.fold((0, 0.0), |best, next| if next.1 > best.1 { next } else { best });
        let Some(cameras) = seen.get(&best.0).filter(|_| best.1 > 0.0) else { break };
        for (camera, _) in cameras.iter().filter(|(_, extent)| extent.count >= LEAST) {
            chosen.entry(*camera).or_insert(best.0);
        }
    }
    chosen.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics, Modality};
    use glam::DVec3;

    use super::*;
    use crate::evidence::Residual;
    use erfgs_scene::rig_file::RigCamera;

    #[test]
    fn cameras_are_shown_at_one_instant_where_there_is_one() {
        let distortion = Distortion::None;
        let intrinsics = Intrinsics { width: 100, height: 100, fx: 100.0, fy: 100.0, cx: 50.0, cy: 50.0, distortion };
        let names = ["a", "b", "c", "blind"];
        let cameras = names.map(|name| RigCamera::new(name, Modality::Rgb, intrinsics, None)).to_vec();
        let rig = RigFile::new("board", true, cameras);
        let mut evidence = Evidence::default();
        // Two saw placements 4 and 5, larger in 5; the third saw only 6, and 7 from too few corners.
        let boards =
            [(0, 4, 10.0, 4), (1, 4, 10.0, 4), (0, 5, 40.0, 4), (1, 5, 40.0, 4), (2, 6, 10.0, 4), (2, 7, 90.0, 2)];
        for (camera, placement, size, corners) in boards {
            for (x, y) in [(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)].into_iter().take(corners) {
                let pixel = DVec2::new(x, y) * size;
                evidence.residuals.push(Residual {
                    camera,
                    placement,
                    on_target: DVec3::new(x, y, 0.0),
                    side: None,
                    pixel,
                    at_instant: pixel,
                    residual: None,
                    used: true,
                });
            }
        }
        assert_eq!(telling(&rig, &evidence), [(0, 5), (1, 5), (2, 6)]);
        assert!(telling(&rig, &Evidence::default()).is_empty());
    }
}
