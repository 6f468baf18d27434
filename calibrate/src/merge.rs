//! Several rig files made one: lenses of one and places of another, or rigs that share cameras.

use erfgs_scene::rig_file::RigFile;

use crate::{
    check::{Tolerance, compare},
    geometry::Similarity,
    landmarks::moved,
};

/// Rigs that cannot be made one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// Both have poses, and nothing ties them.
    #[error(
        "rig {number} has poses and none of its cameras has one in the rigs before it, so that they cannot be aligned; calibrate a \
         recording that cameras of both see"
    )]
    Apart {
        /// Which rig, counted from 1.
        number: usize,
    },
    /// One is in metres and the other is not.
    #[error(
        "rig {number} has another unit: one is in metres and the other has no scale; give it one (calibrate points --keep-poses)"
    )]
    Unit {
        /// Which rig, counted from 1.
        number: usize,
    },
    /// The same name for images of different sizes.
    #[error("camera {camera} has images of {a:?} pixels in one rig and of {b:?} in another; rename one of them")]
    Size {
        /// The camera.
        camera: String,
        /// Its size before.
        a: [u32; 2],
        /// Its size in the later rig.
        b: [u32; 2],
    },
}

/// Makes one rig of several. Of a camera that two have, the earlier one's lens and place are kept, and what it lacks is taken
/// from the later one. The world is that of the first rig with poses; others are laid over it by the camera that they share with
/// it and that most others agree with.
///
/// # Errors
/// If nothing ties two rigs with poses, their units differ, or a camera has two sizes.
pub fn merge(rigs: &[RigFile]) -> Result<RigFile, MergeError> {
    let posed = |rig: &RigFile| rig.cameras.iter().any(|camera| camera.pose.is_some());
    let mut merged = RigFile::new("merge", true, Vec::new());
    for (index, rig) in rigs.iter().enumerate() {
        let number = index + 1;
        let mut rig = rig.clone();
        if posed(&merged) && posed(&rig) {
            if merged.metric != rig.metric {
                return Err(MergeError::Unit { number });
            }
            let (motion, warning) = over(&merged, &rig).ok_or(MergeError::Apart { number })?;
            rig = moved(&rig, &motion);
            merged.warnings.extend(warning);
        } else if posed(&rig) {
            merged.metric = rig.metric;
        }
        merged.warnings.extend(rig.warnings);
        for camera in rig.cameras {
            let Some(known) = merged.cameras.iter_mut().find(|known| known.name == camera.name) else {
                merged.cameras.push(camera);
                continue;
            };
            let (a, b) = (known.intrinsics, camera.intrinsics);
            if [a.width, a.height] != [b.width, b.height] {
                let (a, b) = ([a.width, a.height], [b.width, b.height]);
                return Err(MergeError::Size { camera: camera.name, a, b });
            }
            if known.pose.is_none() && camera.pose.is_some() {
                // A place was found with the lens beside it, and holds for no other.
                if known.intrinsics != camera.intrinsics {
                    merged.warnings.push(format!("{}: its lens is that of the rig with its place", camera.name));
                }
                *known = camera;
            }
        }
    }
    Ok(merged)
}

/// What lays `later` over `earlier`, and what does not agree.
fn over(earlier: &RigFile, later: &RigFile) -> Option<(Similarity, Option<String>)> {
    let (anchor, warning) = match compare(earlier, later, Tolerance::default()) {
        Ok(comparison) => {
            let moved: Vec<String> =
                comparison.moved().map(|drift| format!("{} by {:.1} mm", drift.camera, drift.shift_mm)).collect();
            let warning = format!("the rigs disagree on camera poses ({}): did the cameras move?", moved.join(", "));
            (comparison.anchor, (!moved.is_empty()).then_some(warning))
        }
        Err(_) => {
            let both = |name: &String| later.camera(name).is_some_and(|camera| camera.pose.is_some());
            let posed = earlier.cameras.iter().filter(|camera| camera.pose.is_some()).map(|camera| camera.name.clone());
            (posed.into_iter().find(both)?, None)
        }
    };
    let (before, after) = (earlier.camera(&anchor)?.pose?, later.camera(&anchor)?.pose?);
    // From the later world through the anchor to the earlier one.
    let pose = after.then(&before.inverse());
    Some((Similarity { scale: 1.0, pose }, warning))
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics, Modality, Pose, rig_file::RigCamera};
    use glam::{DQuat, DVec3};

    use super::*;

    fn camera(name: &str, x: f64) -> RigCamera {
        let intrinsics =
            Intrinsics { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0, distortion: Distortion::None };
        RigCamera::new(
            name,
            Modality::Rgb,
            intrinsics,
            Some(Pose::look_at(DVec3::new(x, 0.3, -2.0), DVec3::ZERO, DVec3::Y)),
        )
    }

    fn rig(cameras: &[(&str, f64)]) -> RigFile {
        RigFile::new("board", true, cameras.iter().map(|(name, x)| camera(name, *x)).collect())
    }

    fn elsewhere(rig: &RigFile) -> RigFile {
        let pose = Pose { rotation: DQuat::from_rotation_y(0.7), translation: DVec3::new(1.0, 2.0, 3.0) };
        moved(rig, &Similarity { scale: 1.0, pose })
    }

    #[test]
    fn rigs_that_share_a_camera_become_one() {
        let truth = rig(&[("a", -1.0), ("b", 0.0), ("c", 1.0)]);
        for shared in [vec![("b", 0.0), ("c", 1.0)], vec![("a", -1.0), ("b", 0.0), ("c", 1.0)]] {
            let merged = merge(&[rig(&[("a", -1.0), ("b", 0.0)]), elsewhere(&rig(&shared))]).unwrap();
            assert_eq!((merged.cameras.len(), merged.warnings.len()), (3, 0));
            for (found, known) in merged.cameras.iter().zip(&truth.cameras) {
                assert!(found.pose.unwrap().centre().distance(known.pose.unwrap().centre()) < 1e-9, "{found:?}");
            }
        }
        let one = merge(&[rig(&[("a", -1.0)]), rig(&[("b", 0.0)])]);
        assert_eq!(one, Err(MergeError::Apart { number: 2 }));
        let mut other = rig(&[("a", -1.0)]);
        other.metric = false;
        assert_eq!(merge(&[rig(&[("a", 0.0)]), other]), Err(MergeError::Unit { number: 2 }));
    }

    #[test]
    fn lenses_and_places_come_together_and_sizes_must_agree() {
        let mut lenses = rig(&[("a", 0.0), ("b", 1.0)]);
        lenses.cameras.iter_mut().for_each(|camera| camera.pose = None);
        let merged = merge(&[lenses.clone(), rig(&[("a", 0.0)])]).unwrap();
        assert_eq!(merged.cameras.iter().map(|camera| camera.pose.is_some()).collect::<Vec<_>>(), [true, false]);
        lenses.cameras[0].intrinsics.width = 65;
        assert!(matches!(merge(&[lenses, rig(&[("a", 0.0)])]), Err(MergeError::Size { .. })));
        // A camera that moved is named.
        let mut later = rig(&[("a", -1.0), ("b", 0.0), ("c", 1.0)]);
        let earlier = later.clone();
        later.cameras[1].pose.as_mut().unwrap().translation.x += 0.05;
        let merged = merge(&[earlier, later]).unwrap();
        assert!(merged.warnings[0].contains("b by 50.0 mm"), "{:?}", merged.warnings);
    }
}
