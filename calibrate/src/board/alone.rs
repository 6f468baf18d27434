//! What each camera says by itself: its intrinsics, or how well those that are given fit.

use erfgs_scene::{Intrinsics, Pose};

use super::{
    BoardDetections, BoardError, BoardOptions, Plate,
    doubt::{DEVIATIONS, GIVEN_PX, MOST_MOVED, MOST_RESIDUAL_PX, MOVED},
    intrinsics::{Single, board_pose, observations, single, spread},
};
use crate::{
    bundle::{Bundle, BundleCamera, Loss, Options, Placement, Solution},
    evidence::Moment,
};

/// One camera, by itself.
pub(super) struct Alone {
    /// As they were found, or as given.
    pub intrinsics: Intrinsics,
    /// The problem, solved: the camera at the origin, one board for each view.
    pub bundle: Bundle,
    /// When each board was seen.
    pub moments: Vec<Moment>,
    /// How it went, where anything was solved.
    pub solution: Option<Solution>,
    /// Where the intrinsics were not given: the same, with what is known of them.
    pub single: Option<Single>,
    /// Where they were given: the focal length that the views would have, and its deviation, pixels.
    would_be: Option<[f64; 2]>,
}

impl Alone {
    /// Finds the camera's intrinsics, or takes those that are known.
    pub fn of(seen: &BoardDetections, plate: &Plate, options: &BoardOptions) -> Result<Self, BoardError> {
        if let Some(known) = options.known.get(&seen.camera) {
            return Self::known(seen, plate, options, known);
        }
        let single = single(seen, plate, options.model, options.square_pixels)?;
        Ok(Self {
            intrinsics: single.bundle.cameras[0].intrinsics,
            bundle: single.bundle.clone(),
            moments: single.moments.clone(),
            solution: Some(single.solution.clone()),
            single: Some(single),
            would_be: None,
        })
    }

    /// The boards before a camera whose lens is known.
    fn known(
        seen: &BoardDetections,
        plate: &Plate,
        options: &BoardOptions,
        intrinsics: &Intrinsics,
    ) -> Result<Self, BoardError> {
        let camera = BundleCamera {
            name: seen.camera.clone(),
            intrinsics: *intrinsics,
            pose: Pose::IDENTITY,
            time_offset_s: 0.0,
            free: Vec::new(),
        };
        let mut bundle = Bundle { cameras: vec![camera], ..Bundle::default() };
        let mut moments = Vec::new();
        for view in seen.views.iter().filter(|view| spread(view)) {
            let Some(pose) = board_pose(view, plate, intrinsics) else { continue };
            moments.push(view.moment());
            bundle.observations.extend(observations(view, plate, 0, bundle.placements.len(), 1.0));
            bundle.placements.push(Placement::Board(pose));
        }
        if bundle.placements.is_empty() {
            return Err(seen.too_few(plate, 0, 1));
        }
        let solution = bundle.solve(&Options { loss: Loss::Cauchy(3.0), ..Options::default() })?;
        let would_be = single(seen, plate, options.model, true).ok().map(|own| {
            let camera = &own.bundle.cameras[0];
            [camera.intrinsics.fx, own.uncertainty.cameras[0].sigma[0]]
        });
        let (intrinsics, solution) = (*intrinsics, Some(solution));
        Ok(Self { intrinsics, bundle, moments, solution, single: None, would_be })
    }

    /// Whether intrinsics that were given are not this camera's: how grave that is (1 is too grave), and a sentence.
    pub fn is_another(&self) -> Option<(f64, String)> {
        if self.single.is_some() {
            return None;
        }
        let (name, given, left_px) = (&self.bundle.cameras[0].name, self.intrinsics.fx, self.rms_px());
        let elsewhere = "they are those of another camera, zoom or resolution";
        if let Some([focal, sigma]) = self.would_be
            && (focal - given).abs() > (DEVIATIONS * sigma).max(2.0 * MOVED * given)
        {
            let text = format!(
                "the given intrinsics of {name} have a focal length of {given:.0} px, but its views give {focal:.0} ± {sigma:.0} px: \
                 {elsewhere}"
            );
            return Some(((focal - given).abs() / given / (2.0 * MOST_MOVED), text));
        }
        (left_px > GIVEN_PX).then(|| {
            let text = format!("the given intrinsics of {name} alone leave a residual of {left_px:.1} px: {elsewhere}");
            (left_px / MOST_RESIDUAL_PX, text)
        })
    }

    /// Root mean square residual, pixels.
    pub fn rms_px(&self) -> f64 {
        self.bundle.rms_px(None).0
    }

    /// The standard deviation of a corner in either direction, pixels, beside other cameras: what this one leaves over by itself,
    /// but no less than what frames of not quite the same instant and boards that bend add. A camera with sharp corners would
    /// else have its way against all others.
    pub fn sigma_px(&self) -> f64 {
        const LEAST_PX: f64 = 0.3;
        (self.rms_px() / 2f64.sqrt()).max(LEAST_PX)
    }
}
