//! The calibration of one camera while its frames come in: which views are worth keeping, where in the image the board has
//! been, how well the views fit so far, and what to show the camera next.

use glam::{DVec2, DVec3};
use serde::Serialize;

use super::{BoardDetections, BoardError, BoardView, Corner, LensModel, Single, Target, moved::moved_px, single};
use crate::{
    bundle::{Parameter, Placement},
    coverage::Coverage,
};

/// Columns and rows of the grid over the image on which coverage is counted.
pub const GRID: [usize; 2] = [12, 8];
/// A view is worth keeping if its corners moved by this share of the image's diagonal from every view that is kept.
const NEW_SHARE: f64 = 0.04;
/// Views that are kept at most: more of them change next to nothing.
const MOST_VIEWS: usize = 60;
/// From this many views on, a fit waits for as many new ones again.
const FIRST_VIEWS: usize = 8;
/// New views between two fits from then on.
const VIEWS_BETWEEN: usize = 4;
/// A board that was never turned further from the image plane than this, degrees, leaves the focal length open.
const LEAST_TILT_DEG: f64 = 25.0;
/// Share of the image's width or height that the nearest board should fill.
const LEAST_SPAN: f64 = 0.4;
/// Relative standard deviation of the focal length that is good enough.
const ENOUGH: f64 = 0.002;
/// Names of the thirds of an image.
const PLACES: [[&str; 3]; 3] =
    [["upper left", "top", "upper right"], ["left", "middle", "right"], ["lower left", "bottom", "lower right"]];

/// How well the views of a camera fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Root mean square of the reprojection errors over both coordinates of all corners, pixels.
    pub rms_px: f64,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Its standard deviation, pixels.
    pub focal_sigma_px: f64,
    /// Greatest angle between the board and the image plane, degrees.
    pub tilt_deg: f64,
    /// Views that took part.
    pub views: usize,
}

/// What is known of a camera at one moment.
#[derive(Clone, Debug)]
pub struct QuickState {
    /// The camera's name.
    pub camera: String,
    /// Width and height of its images, pixels.
    pub size: [u32; 2],
    /// See [`Quick::last`].
    pub last: Vec<Corner>,
    /// See [`Quick::counts`].
    pub counts: [usize; 3],
    /// See [`Quick::coverage`].
    pub coverage: Vec<u32>,
    /// See [`Quick::fit`].
    pub fit: Option<Fit>,
    /// See [`Quick::advice`].
    pub advice: Option<String>,
}

/// One camera that is being calibrated.
#[derive(Clone, Debug)]
pub struct Quick {
    target: Target,
    model: LensModel,
    seen: BoardDetections,
    frames_with_board: usize,
    last: Vec<Corner>,
    coverage: Coverage,
    fitted_at: usize,
    fit: Option<Fit>,
    failure: Option<String>,
}

impl Quick {
    /// Nothing seen yet by `camera`, whose images have `size` columns and rows; `events` tells where they come from.
    #[must_use]
    pub fn new(camera: &str, events: bool, size: [u32; 2], target: Target, model: LensModel) -> Self {
        Self {
            target,
            model,
            seen: BoardDetections {
                camera: camera.into(),
                events,
                size,
                source: "live".into(),
                ..BoardDetections::default()
            },
            frames_with_board: 0,
            last: Vec::new(),
            coverage: Coverage::new(size, GRID),
            fitted_at: 0,
            fit: None,
            failure: None,
        }
    }

    /// Takes note of the corners that were found in a frame; none if the board is not in it.
    pub fn see(&mut self, corners: Vec<Corner>) {
        self.seen.frames += 1;
        if corners.is_empty() {
            self.last.clear();
            return;
        }
        self.frames_with_board += 1;
        if self.is_new(&corners) && self.seen.views.len() < MOST_VIEWS {
            corners.iter().for_each(|corner| self.coverage.see(corner.pixel));
            let instant = self.seen.frames.to_string();
            self.seen.views.push(BoardView {
                instant,
                time_s: None,
                file: "live".into(),
                frame: 0,
                corners: corners.clone(),
            });
        }
        self.last = corners;
    }

    /// Whether no view that is kept looks much like this one.
    fn is_new(&self, corners: &[Corner]) -> bool {
        let [width, height] = self.seen.size.map(f64::from);
        let least = NEW_SHARE * width.hypot(height);
        self.seen.views.iter().all(|view| moved_px(&view.corners, corners) > least)
    }

    /// Fits the camera to its views, if enough came since the last time; returns whether it did.
    pub fn refit(&mut self) -> bool {
        let views = self.seen.views.len();
        let due = if views <= FIRST_VIEWS { self.fitted_at + 1 } else { self.fitted_at + VIEWS_BETWEEN };
        if views < 3 || views < due.min(MOST_VIEWS) || views == self.fitted_at {
            return false;
        }
        self.fitted_at = views;
        match single(&self.seen, &self.target, self.model, false) {
            Ok(single) => (self.fit, self.failure) = (Some(fit(&single)), None),
            // The views do not determine a focal length yet: a matter of more of them.
            Err(BoardError::NoFocal { .. } | BoardError::Open { .. } | BoardError::TooFewViews { .. }) => {
                self.fit = None
            }
            Err(error) => (self.fit, self.failure) = (None, Some(error.to_string())),
        }
        true
    }

    /// All that is known now.
    #[must_use]
    pub fn state(&self) -> QuickState {
        QuickState {
            camera: self.seen.camera.clone(),
            size: self.seen.size,
            last: self.last.clone(),
            counts: self.counts(),
            coverage: self.coverage(),
            fit: self.fit(),
            advice: self.advice(),
        }
    }

    /// The corners in the frame that was looked at last.
    #[must_use]
    pub fn last(&self) -> &[Corner] {
        &self.last
    }

    /// Frames that were looked at, those with the board, and views that are kept.
    #[must_use]
    pub fn counts(&self) -> [usize; 3] {
        [self.seen.frames, self.frames_with_board, self.seen.views.len()]
    }

    /// How many corners of the kept views lie in each cell of the image, row by row; see [`GRID`].
    #[must_use]
    pub fn coverage(&self) -> Vec<u32> {
        self.coverage.counts().to_vec()
    }

    /// How well the views fit, if they determine a camera.
    #[must_use]
    pub fn fit(&self) -> Option<Fit> {
        self.fit
    }

    /// What would help most now, for the person who holds the board; `None` if there is enough.
    #[must_use]
    pub fn advice(&self) -> Option<String> {
        if let Some(failure) = &self.failure {
            return Some(failure.clone());
        }
        if self.seen.views.len() < 3 {
            return Some(format!("show the whole board ({} of 3 views)", self.seen.views.len()));
        }
        if let Some(place) = self.bare_place() {
            return Some(format!("move the board to the {place} of the image"));
        }
        if self.nearest_span() < LEAST_SPAN {
            return Some("bring the board nearer".into());
        }
        match self.fit {
            Some(fit) if fit.tilt_deg < LEAST_TILT_DEG => {
                Some(format!("tilt the board: {:.0} degrees at most so far", fit.tilt_deg))
            }
            None => Some("tilt the board about both axes: the focal length is open".into()),
            Some(fit) if fit.focal_sigma_px > ENOUGH * fit.focal_px => Some("more views, near and tilted".into()),
            Some(_) => None,
        }
    }

    /// A ninth of the image where the board has hardly been, the emptiest first.
    fn bare_place(&self) -> Option<&'static str> {
        let (mut bare, mut least) = (None, f64::INFINITY);
        for (row, names) in PLACES.iter().enumerate() {
            for (column, name) in names.iter().enumerate() {
                let range = |third: usize, cells: usize| third * cells / 3..(third + 1) * cells / 3;
                let cells: Vec<u32> = range(row, GRID[1])
                    .flat_map(|y| range(column, GRID[0]).map(move |x| (x, y)))
                    .map(|(x, y)| self.coverage.at(x, y))
                    .collect();
                let covered = cells.iter().filter(|count| **count > 0).count() as f64 / cells.len() as f64;
                if covered < 0.25 && covered < least {
                    (bare, least) = (Some(*name), covered);
                }
            }
        }
        bare
    }

    /// The greatest share of the image's width or height that a view of the board fills.
    fn nearest_span(&self) -> f64 {
        let size = DVec2::from(self.seen.size.map(f64::from));
        let span = |view: &BoardView| {
            let pixels = || view.corners.iter().map(|corner| corner.pixel);
            let low = pixels().fold(DVec2::INFINITY, DVec2::min);
            let high = pixels().fold(DVec2::NEG_INFINITY, DVec2::max);
            ((high - low) / size).max_element()
        };
        self.seen.views.iter().map(span).fold(0.0, f64::max)
    }
}

fn fit(single: &Single) -> Fit {
    let camera = &single.bundle.cameras[0];
    let focal = camera.free.iter().position(|parameter| *parameter == Parameter::Fx);
    let sigma = single.uncertainty.cameras.first().zip(focal).and_then(|(camera, at)| camera.sigma.get(at));
    let tilt = |placement: &Placement| match placement {
        Placement::Board(pose) => (pose.rotation * DVec3::Z).z.abs().min(1.0).acos().to_degrees(),
        _ => 0.0,
    };
    Fit {
        rms_px: single.bundle.rms_px(None).0,
        focal_px: camera.intrinsics.fx,
        focal_sigma_px: sigma.copied().unwrap_or(f64::INFINITY),
        tilt_deg: single.bundle.placements.iter().map(tilt).fold(0.0, f64::max),
        views: single.bundle.placements.len(),
    }
}
