//! Intrinsics of one camera from its views of a board.

use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DVec2, DVec3};

use super::{BoardDetections, BoardError, BoardView, Plate};
use crate::{
    bundle::{
        Bundle, BundleCamera, CameraUncertainty, Loss, Observation, Options, Parameter, Placement, Solution,
        Uncertainty, free_lens,
        jackknife::{MOST_GROUPS, successive},
    },
    evidence::Moment,
    geometry::homography::plane_pose,
    statistics::median,
};

/// How the lens is modelled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LensModel {
    /// No distortion.
    Pinhole,
    /// Brown-Conrady with k1, k2, p1, p2, which Kalibr calls radtan.
    Brown4,
    /// Brown-Conrady with k1, k2, p1, p2, k3.
    #[default]
    Brown5,
    /// Brown-Conrady's rational form with eight coefficients.
    Brown8,
    /// Kannala-Brandt's fisheye with four.
    Fisheye,
}

/// Views that are needed at least.
const LEAST_VIEWS: usize = 3;
/// A focal length whose standard deviation is a greater share of it is none: so far from the truth the cost is no parabola, and
/// the standard deviation itself much too small.
const VAGUE: f64 = 0.05;
/// Focal lengths that are tried at the start, in image widths.
const FOCALS: [f64; 9] = [0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0];

/// One camera, calibrated alone.
#[derive(Clone, Debug)]
pub struct Single {
    /// The problem, solved: one camera at the origin, one board for each view.
    pub bundle: Bundle,
    /// How it went.
    pub solution: Solution,
    /// How well it is determined.
    pub uncertainty: Uncertainty,
    /// When each board was seen.
    pub moments: Vec<Moment>,
}

impl LensModel {
    fn none(self) -> Distortion {
        match self {
            Self::Pinhole => Distortion::None,
            Self::Brown4 | Self::Brown5 | Self::Brown8 => Distortion::BrownConrady([0.0; 8]),
            Self::Fisheye => Distortion::KannalaBrandt([0.0; 4]),
        }
    }

    /// All intrinsic parameters of the model.
    #[must_use]
    pub fn parameters(self) -> Vec<Parameter> {
        free_lens(match self {
            Self::Pinhole => 0,
            Self::Fisheye | Self::Brown4 => 4,
            Self::Brown5 => 5,
            Self::Brown8 => 8,
        })
    }

    /// The same; with `square`, fy/fx is held.
    pub(super) fn parameters_with(self, square: bool) -> Vec<Parameter> {
        let mut free = self.parameters();
        if square {
            free.retain(|parameter| !matches!(parameter, Parameter::Fx | Parameter::Fy));
            free.insert(0, Parameter::Focal);
        }
        free
    }
}

/// Calibrates one camera. `aspect` holds fy/fx at 1.
///
/// # Errors
/// If there are too few views, or they leave a parameter open.
pub fn single(
    seen: &BoardDetections,
    plate: impl Into<Plate>,
    model: LensModel,
    aspect: bool,
) -> Result<Single, BoardError> {
    let plate = &plate.into();
    let views: Vec<&BoardView> = seen.views.iter().filter(|view| spread(view)).collect();
    if views.len() < LEAST_VIEWS {
        return Err(seen.too_few(plate, views.len(), LEAST_VIEWS));
    }
    let (mut bundle, moments) = start(seen, &views, plate, model)?;
    bundle.cameras[0].free = model.parameters_with(aspect);
    bundle.solve(&Options { loss: Loss::Cauchy(3.0), ..Options::default() })?;
    mark_gross(&mut bundle);
    let solution = bundle.solve(&Options::default())?;
    let uncertainty = bundle.uncertainty_of_groups(Loss::Squared, &successive(bundle.placements.len(), MOST_GROUPS))?;
    if let Some(open) = uncertainty.open.first() {
        let focal =
            open.parameters.iter().any(|(_, p, _)| matches!(p, Parameter::Focal | Parameter::Fx | Parameter::Fy));
        if focal {
            return Err(BoardError::NoFocal { camera: seen.camera.clone(), views: views.len(), found: None });
        }
        let names = open.parameters.iter().map(|(_, parameter, _)| parameter.name(&bundle.cameras[0]));
        let what = format!("{} of camera {}", names.collect::<Vec<_>>().join(", "), seen.camera);
        return Err(BoardError::Open { what });
    }
    let vague = focals(&bundle.cameras[0], &uncertainty.cameras[0]).find(|[focal, sigma]| *sigma > VAGUE * focal);
    if vague.is_some() {
        return Err(BoardError::NoFocal { camera: seen.camera.clone(), views: views.len(), found: vague });
    }
    Ok(Single { bundle, solution, uncertainty, moments })
}

/// The focal lengths that were estimated, with their standard deviations, pixels.
pub(super) fn focals<'a>(
    camera: &'a BundleCamera,
    known: &'a CameraUncertainty,
) -> impl Iterator<Item = [f64; 2]> + 'a {
    let is_focal = |parameter: &Parameter| matches!(parameter, Parameter::Focal | Parameter::Fx | Parameter::Fy);
    let both = camera.free.iter().zip(&known.sigma).filter(move |(parameter, _)| is_focal(parameter));
    both.map(|(parameter, sigma)| [parameter.value(camera), *sigma])
}

/// Marks what a mistaken corner is, as against a lens that does not fit: far beyond the others.
pub(super) fn mark_gross(bundle: &mut Bundle) {
    let residuals = bundle.observations.iter().filter_map(|o| bundle.residual_px(o));
    let typical = median(residuals.map(DVec2::length)).unwrap_or(0.0);
    bundle.mark_outliers(0.0, (8.0 * typical).max(1.0));
}

/// Whether a view has corners enough for a pose of the board.
pub(super) fn spread(view: &BoardView) -> bool {
    view.corners.len() >= 6
}

/// The pose of the board's side that a view shows, before a camera with these intrinsics.
pub(super) fn board_pose(view: &BoardView, plate: &Plate, intrinsics: &Intrinsics) -> Option<Pose> {
    let (on_plane, rays): (Vec<DVec2>, Vec<DVec3>) = plate
        .points(view)
        .filter_map(|(corner, point)| Some((point.truncate(), intrinsics.unproject(corner.pixel).ok()?)))
        .unzip();
    plane_pose(&on_plane, &rays)
}

/// The observations of a view, in the frame of the board's side that it shows.
pub(super) fn observations<'a>(
    view: &'a BoardView,
    plate: &'a Plate,
    camera: usize,
    placement: usize,
    sigma_px: f64,
) -> impl Iterator<Item = Observation> + 'a {
    plate.points(view).map(move |(corner, on_target)| {
        let (pixel, velocity) = (corner.pixel, DVec2::ZERO);
        Observation { camera, placement, on_target, side: None, pixel, sigma_px, velocity, used: true }
    })
}

/// A first guess: of several focal lengths, the one with which boards fit best after a few steps.
fn start(
    seen: &BoardDetections,
    views: &[&BoardView],
    plate: &Plate,
    model: LensModel,
) -> Result<(Bundle, Vec<Moment>), BoardError> {
    let [width, height] = seen.size;
    let mut best: Option<(f64, Bundle, Vec<Moment>)> = None;
    for share in FOCALS {
        let focal = share * f64::from(width.max(height));
        let (cx, cy) = (0.5 * f64::from(width), 0.5 * f64::from(height));
        let intrinsics = Intrinsics { width, height, fx: focal, fy: focal, cx, cy, distortion: model.none() };
        let mut bundle = Bundle {
            cameras: vec![BundleCamera {
                name: seen.camera.clone(),
                intrinsics,
                pose: Pose::IDENTITY,
                time_offset_s: 0.0,
                free: vec![Parameter::Focal],
            }],
            ..Bundle::default()
        };
        let mut moments = Vec::new();
        for view in views {
            let Some(pose) = board_pose(view, plate, &intrinsics) else { continue };
            moments.push(view.moment());
            bundle.observations.extend(observations(view, plate, 0, bundle.placements.len(), 1.0));
            bundle.placements.push(Placement::Board(pose));
        }
        if bundle.placements.len() < LEAST_VIEWS {
            continue;
        }
        if !matches!(model, LensModel::Pinhole) {
            bundle.cameras[0].free.push(Parameter::Coefficient(0));
        }
        let options = Options { loss: Loss::Cauchy(3.0), iterations: 25, ..Options::default() };
        let solution = bundle.solve(&options)?;
        // Each view that could not even be guessed counts as badly as one that does not fit.
        let missing = (views.len() - bundle.placements.len()) as f64;
        let cost = solution.steps.iter().filter(|step| step.taken).map(|step| step.cost).fold(f64::INFINITY, f64::min);
        let cost = cost / bundle.observations.len() as f64 * (1.0 + missing);
        if cost.is_finite() && best.as_ref().is_none_or(|(least, ..)| cost < *least) {
            best = Some((cost, bundle, moments));
        }
    }
    match best {
        Some((_, bundle, moments)) => Ok((bundle, moments)),
        None => Err(BoardError::NoFocal { camera: seen.camera.clone(), views: views.len(), found: None }),
    }
}
