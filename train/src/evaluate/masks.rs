//! The moving pixels of held-out frames: masks from the dataset, or made from the motion in the frames.

use std::collections::BTreeMap;

use super::read;
use crate::{
    metrics::{Changes, MotionMaskOptions, fast_from, motion_masks},
    scene::{HeldOutFrame, Scene, SceneError},
    trainer::TrainError,
};
use erfgs_run::MaskKind;

/// A mask for each held-out frame.
#[derive(Debug)]
pub struct HeldOutMasks {
    /// Where they came from.
    pub kind: MaskKind,
    masks: BTreeMap<(usize, usize), Vec<bool>>,
}

impl HeldOutMasks {
    /// The dataset's masks if every held-out frame has one, else masks made from motion.
    ///
    /// # Errors
    /// [`TrainError`] where a frame or a mask cannot be read.
    pub fn new(scene: &Scene) -> Result<Self, TrainError> {
        let mut masks = BTreeMap::new();
        for frame in &scene.held_out {
            let camera = &scene.dataset.manifest.cameras[frame.view];
            let given = scene.dataset.read_mask(camera, &camera.frames[frame.index]).map_err(SceneError::from)?;
            let Some(mask) = given else { return Self::from_motion(scene) };
            masks.insert((frame.view, frame.index), mask.data.iter().map(|&value| value > 0).collect());
        }
        Ok(Self { kind: MaskKind::Given, masks })
    }

    fn from_motion(scene: &Scene) -> Result<Self, TrainError> {
        let mut masks = BTreeMap::new();
        for (view, of_view) in by_view(scene) {
            let frames: Vec<&HeldOutFrame> = of_view.iter().map(|&at| &scene.held_out[at]).collect();
            let images = read_all(scene, &frames)?;
            let size = scene.views[view].view;
            let bytes: Vec<&[u8]> = images.iter().map(Vec::as_slice).collect();
            let made = motion_masks(size.width, size.height, &bytes, &MotionMaskOptions::default())?;
            masks.extend(frames.iter().zip(made).map(|(frame, mask)| ((view, frame.index), mask)));
        }
        Ok(Self { kind: MaskKind::Motion, masks })
    }

    /// The pixels of each held-out frame that are fast (see [`Changes`]), in the order of the scene's; none where nothing changes.
    ///
    /// # Errors
    /// [`TrainError`] where a frame cannot be read.
    pub(super) fn fast(&self, scene: &Scene) -> Result<Vec<Vec<bool>>, TrainError> {
        let by_view = by_view(scene);
        let mut changes = Vec::with_capacity(by_view.len());
        for (view, of_view) in &by_view {
            let frames: Vec<&HeldOutFrame> = of_view.iter().map(|&at| &scene.held_out[at]).collect();
            let images = read_all(scene, &frames)?;
            let bytes: Vec<&[u8]> = images.iter().map(Vec::as_slice).collect();
            let masks: Vec<&[bool]> = frames.iter().map(|frame| self.of(frame)).collect();
            let size = scene.views[*view].view;
            changes.push(Changes::of(size.width, size.height, &bytes, &masks)?);
        }
        let mut fast = vec![Vec::new(); scene.held_out.len()];
        let least = fast_from(&changes).unwrap_or(u16::MAX);
        for (changes, of_view) in changes.iter().zip(by_view.values()) {
            for (index, &at) in of_view.iter().enumerate() {
                fast[at] = changes.mask(index, self.of(&scene.held_out[at]), least);
            }
        }
        Ok(fast)
    }

    /// The mask of a frame, row-major; true where it moves.
    #[must_use]
    pub fn of(&self, frame: &HeldOutFrame) -> &[bool] {
        self.masks.get(&(frame.view, frame.index)).map_or(&[], Vec::as_slice)
    }
}

/// The held-out frames of each view in the order of time, by their places among all of the scene's.
fn by_view(scene: &Scene) -> BTreeMap<usize, Vec<usize>> {
    let mut by_view: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (at, frame) in scene.held_out.iter().enumerate() {
        by_view.entry(frame.view).or_default().push(at);
    }
    by_view.values_mut().for_each(|of_view| of_view.sort_by_key(|&at| scene.held_out[at].t_ns));
    by_view
}

fn read_all(scene: &Scene, frames: &[&HeldOutFrame]) -> Result<Vec<Vec<u8>>, TrainError> {
    frames.iter().map(|frame| Ok(read(&scene.dataset, frame)?.data)).collect()
}
