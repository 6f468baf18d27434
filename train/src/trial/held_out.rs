//! Which cameras are kept apart.

use erfgs_dataset::{Camera, Dataset, Split};
use serde::{Deserialize, Serialize};

/// With fewer cameras that take frames, each is needed.
const FEWEST_WITH_FRAMES: usize = 4;
/// With fewer cameras that have events, likewise.
const FEWEST_WITH_EVENTS: usize = 2;

/// The cameras that take no part in the trainings of a trial, by name; none where there are so few that each is needed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeldOut {
    /// One that takes frames.
    pub frames: Option<String>,
    /// One that has events.
    pub events: Option<String>,
}

/// The dataset without the cameras that are kept apart: those that see what others see, too.
pub(super) fn keep_apart(dataset: &Dataset) -> (Dataset, HeldOut) {
    let mut dataset = dataset.clone();
    let cameras = &mut dataset.manifest.cameras;
    let frames = most_central(cameras, FEWEST_WITH_FRAMES, |camera| !camera.frames.is_empty());
    if let Some(index) = frames {
        cameras[index].split = Split::Test;
    }
    // One that has both tells both.
    let events = frames
        .filter(|&index| cameras[index].events.is_some())
        .or_else(|| most_central(cameras, FEWEST_WITH_EVENTS, |camera| camera.events.is_some()));
    if let Some(index) = events {
        cameras[index].split = Split::Test;
    }
    let name = |index: Option<usize>| index.map(|index| dataset.manifest.cameras[index].name.clone());
    let held_out = HeldOut { frames: name(frames), events: name(events) };
    (dataset, held_out)
}

/// The training camera of a kind that is nearest to another one of it; none of fewer than so many.
fn most_central(cameras: &[Camera], fewest: usize, is: impl Fn(&Camera) -> bool) -> Option<usize> {
    let of_kind: Vec<usize> =
        (0..cameras.len()).filter(|&index| cameras[index].split == Split::Train && is(&cameras[index])).collect();
    if of_kind.len() < fewest {
        return None;
    }
    let centre = |index: usize| cameras[index].world_to_camera.centre();
    let apart = |index: usize| -> f64 {
        let mut all: Vec<f64> = of_kind.iter().map(|&other| centre(index).distance(centre(other))).collect();
        all.sort_by(f64::total_cmp);
        // Itself is the first; those on either side.
        all.iter().skip(1).take(2).sum()
    };
    of_kind.iter().copied().min_by(|&a, &b| apart(a).total_cmp(&apart(b)))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use erfgs_dataset::Frame;
    use erfgs_scene::{Modality, Pose};

    use super::*;
    use crate::scene::fixtures;

    fn camera(name: &str, x: f64, events: bool) -> Camera {
        let mut camera = fixtures::camera(name, [8, 8], 8.0);
        camera.world_to_camera = Pose { translation: glam::DVec3::new(-x, 0.0, 0.0), ..Pose::IDENTITY };
        if events {
            camera.modality = Modality::Event;
            camera.events = Some(fixtures::events([0, 1]));
        } else {
            camera.frames = vec![Frame { file: "0.png".into(), t_ns: 0, exposure_ns: [0, 0], mask: None }];
        }
        camera
    }

    #[test]
    fn a_camera_between_others_is_kept_apart_where_there_are_enough() {
        let cameras = vec![
            camera("left", 0.0, false),
            camera("middle", 1.0, false),
            camera("near", 1.5, false),
            camera("right", 4.0, false),
            camera("eye", 2.0, true),
        ];
        let all = fixtures::dataset(Path::new("nowhere"), cameras, [0, 1]);
        let (without, held_out) = keep_apart(&all);
        assert_eq!(held_out, HeldOut { frames: Some("middle".into()), events: None });
        let splits: Vec<Split> = without.manifest.cameras.iter().map(|camera| camera.split).collect();
        assert_eq!(splits, [Split::Train, Split::Test, Split::Train, Split::Train, Split::Train]);
        // Three with frames are all needed, and of two with events one is not.
        let mut few = all.clone();
        few.manifest.cameras.remove(3);
        few.manifest.cameras.push(camera("other eye", 3.0, true));
        assert_eq!(keep_apart(&few).1, HeldOut { frames: None, events: Some("eye".into()) });
    }

    #[test]
    fn a_camera_that_has_both_is_kept_apart_for_both() {
        let both = |name: &str, x: f64| {
            let mut camera = camera(name, x, false);
            camera.events = Some(fixtures::events([0, 1]));
            camera
        };
        let cameras = (0..5).map(|k| both(&format!("dvs{k}"), f64::from(k))).collect();
        let all = fixtures::dataset(Path::new("nowhere"), cameras, [0, 1]);
        let (without, held_out) = keep_apart(&all);
        assert_eq!(held_out.frames, held_out.events);
        assert_eq!(without.cameras(Split::Test).count(), 1);
    }
}
