//! How a board calibration is done, and what of that fits nothing that was recorded.

use std::collections::{BTreeMap, BTreeSet};

use erfgs_scene::Intrinsics;

use super::super::{BoardDetections, BoardError, LensModel};
use crate::bundle::Parameter;

/// How a board calibration is done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoardOptions {
    /// The lens model.
    pub model: LensModel,
    /// Whether fy/fx is held at 1.
    pub square_pixels: bool,
    /// Intrinsics that are known, by camera; they are kept.
    pub known: BTreeMap<String, Intrinsics>,
    /// Whether each camera's time offset is estimated, from frame times and how the board moves.
    pub time_offsets: bool,
    /// How far the back of a board with two sides is behind its front, metres, if the sides are parallel and lie one behind the
    /// other. Without it, and where it is not so, the back is found.
    pub back_thickness_m: Option<f64>,
    /// Whether the intrinsics found camera by camera are kept while the poses are adjusted.
    pub keep_intrinsics: bool,
    /// Whether only intrinsics are wanted, and no poses.
    pub intrinsics_only: bool,
    /// Cameras that are left out.
    pub without: BTreeSet<String>,
    /// Instants whose pictures were not taken at once: they tell of lenses, and tie no cameras.
    pub untied: BTreeSet<String>,
    /// The instant whose board is the world: origin at its first corner, x along its rows, z out of the sheet. Without it the
    /// first camera is the world.
    pub origin: Option<String>,
}

impl BoardOptions {
    /// The parameters of a lens that is not known.
    pub(in crate::board) fn lens_parameters(&self) -> Vec<Parameter> {
        self.model.parameters_with(self.square_pixels)
    }
}

/// No plate is thicker, metres.
const THICKEST_M: f64 = 0.2;

/// Refuses options that fit nothing of what was recorded.
pub(super) fn check(seen: &[BoardDetections], options: &BoardOptions) -> Result<(), BoardError> {
    let names = || seen.iter().map(|seen| seen.camera.clone()).collect::<Vec<_>>();
    if let Some(thickness_m) = options.back_thickness_m.filter(|metres| !(0.0..=THICKEST_M).contains(metres)) {
        return Err(BoardError::Thickness { thickness_m });
    }
    let recorded = |name: &String| seen.iter().any(|seen| seen.camera == *name);
    let named = |instant: &String| seen.iter().flat_map(|seen| &seen.views).any(|view| view.instant == *instant);
    if let Some(name) = options.untied.iter().find(|instant| !named(instant)) {
        let known = seen.iter().flat_map(|seen| &seen.views).map(|view| &view.instant).collect::<BTreeSet<_>>();
        return Err(BoardError::NoInstant { name: name.clone(), known: known.into_iter().take(8).cloned().collect() });
    }
    if let Some(name) = options.without.iter().find(|name| !recorded(name)) {
        return Err(BoardError::NoCamera { name: name.clone(), cameras: names() });
    }
    if !options.known.is_empty() && !options.known.keys().any(recorded) {
        let known = options.known.keys().cloned().collect();
        return Err(BoardError::KnowsNone { known, cameras: names() });
    }
    for seen in seen {
        if let Some(known) = options.known.get(&seen.camera)
            && [known.width, known.height] != seen.size
        {
            return Err(BoardError::KnownSize {
                camera: seen.camera.clone(),
                known: [known.width, known.height],
                found: seen.size,
            });
        }
    }
    Ok(())
}
