//! The adjustment of all cameras: robust first, then outliers are marked, then plain least squares.

use super::{Stick, WandOptions, instants::Instant, place};
use crate::{
    bundle::{Bundle, BundleCamera, BundleError, Loss, Options, Parameter, Prior},
    evidence::{Evidence, Moment},
    statistics::median,
};

/// The standard deviation of a LED where none is given, until the residuals tell it, pixels.
const SIGMA_PX: f64 = 0.3;
/// What lies farther from where it should, in standard deviations, is an outlier.
const OUTLIER: f64 = 4.5;
/// A camera that cannot move may fit this many times as badly as the others before that makes its observations outliers.
const ELSEWHERE: f64 = 3.0;
/// The median length of a normal residual in two dimensions, in standard deviations.
const MEDIAN: f64 = 1.1774;
/// A time offset is estimated where the wand moves fast enough to tell it to this, seconds.
const TELLS_S: f64 = 0.01;

/// Which placements are adjusted, and what went before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Round {
    /// Those that are not held out; the poses come from chained pairs.
    First,
    /// The same, after the rig and the wand were brought to one scale.
    Scaled,
    /// All that was seen, the wands that were held out among it.
    All,
}

impl Round {
    fn name(self) -> &'static str {
        match self {
            Self::First => "without held-out",
            Self::Scaled => "without held-out, one scale",
            Self::All => "all placements",
        }
    }
}

/// What a camera's observations are thought to scatter by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scatter {
    /// Standard deviation, pixels.
    pub sigma_px: f64,
    /// Whether it was given.
    pub known: bool,
}

impl Scatter {
    pub fn new(given: Option<f64>) -> Self {
        Self { sigma_px: given.unwrap_or(SIGMA_PX), known: given.is_some() }
    }
}

/// Adjusts `cameras` to what they saw at `instants`, `scatter` where it is not known, and returns the whole problem. `known`
/// are the cameras' focal lengths as known beforehand, pixels. The evidence gets the placements' moments.
pub(super) fn adjust(
    cameras: &[BundleCamera],
    known: &[f64],
    instants: &[&Instant],
    scatter: &mut [Scatter],
    options: &WandOptions,
    round: Round,
    evidence: &mut Evidence,
) -> Result<Bundle, BundleError> {
    let name = round.name();
    let mut bundle;
    (bundle, evidence.moments) = build(&options.stick, cameras, instants, scatter);
    let robust =
        |width, iterations| Options { loss: Loss::Cauchy(width), iterations, tolerance: 1e-7, ..Options::default() };
    if round == Round::First {
        // Poses first: what chained pairs leave of errors must not go into focal lengths.
        for camera in &mut bundle.cameras {
            camera.free.retain(|parameter| Parameter::POSE.contains(parameter));
        }
        let solution = bundle.solve(&robust(30.0, 15))?;
        evidence.pass(format!("{name}: poses, Cauchy loss 30"), &solution);
        // Wands that started at a wrong place get another start.
        (bundle, evidence.moments) = build(&options.stick, &bundle.cameras, instants, scatter);
        for (camera, before) in bundle.cameras.iter_mut().zip(cameras) {
            camera.free.clone_from(&before.free);
        }
    }
    add_priors(&mut bundle, known, options);
    let solution = bundle.solve(&robust(3.0, 40))?;
    evidence.pass(format!("{name}: all, Cauchy loss 3"), &solution);
    let mut marked = mark(&mut bundle);
    for round in 0..4 {
        drop_offsets_that_nothing_tells(&mut bundle);
        let solution = bundle.solve(&Options::default())?;
        evidence.pass(format!("{name}: all, least squares {}", round + 1), &solution);
        let measured = 2 * solution.observations;
        let free = solution.parameters[0] + solution.parameters[1];
        let inflation = (measured as f64 / measured.saturating_sub(free).max(1) as f64).sqrt();
        let learnt = learn(&mut bundle, scatter, inflation);
        let again = mark(&mut bundle);
        if again == marked && !learnt {
            break;
        }
        marked = again;
    }
    Ok(bundle)
}

fn build(stick: &Stick, cameras: &[BundleCamera], instants: &[&Instant], scatter: &[Scatter]) -> (Bundle, Vec<Moment>) {
    let mut bundle = Bundle { cameras: cameras.to_vec(), ..Bundle::default() };
    let mut moments = Vec::new();
    for instant in instants {
        let views: Vec<_> = instant.views.iter().map(|view| (view.camera, view)).collect();
        place::add(&mut bundle, stick, &views, |camera, led| {
            (scatter[camera].sigma_px.hypot(led.extra_px), led.velocity)
        });
        if bundle.placements.len() > moments.len() {
            moments.push(Moment { name: format!("{:.3} s", 1e-9 * instant.t_ns as f64), t_ns: Some(instant.t_ns) });
        }
    }
    (bundle, moments)
}

fn add_priors(bundle: &mut Bundle, known: &[f64], options: &WandOptions) {
    for (index, _) in bundle.cameras.iter().enumerate().filter(|(_, c)| c.free.contains(&Parameter::Focal)) {
        bundle.priors.push(Prior::Value {
            camera: index,
            parameter: Parameter::Focal,
            value: known[index],
            sigma: options.focal_sigma * known[index],
        });
    }
}

/// Keeps a time offset where it is if the wand hardly moved before its camera.
fn drop_offsets_that_nothing_tells(bundle: &mut Bundle) {
    for index in 0..bundle.cameras.len() {
        let seen = bundle.observations.iter().filter(|o| o.used && o.camera == index);
        let information: f64 = seen.map(|o| o.velocity.length_squared() / o.sigma_px.powi(2)).sum();
        if information * TELLS_S * TELLS_S < 1.0 {
            let camera = &mut bundle.cameras[index];
            camera.free.retain(|parameter| *parameter != Parameter::TimeOffset);
            camera.time_offset_s = 0.0;
        }
    }
}

/// The median residual of a camera's observations that take part, over what is expected of normal ones.
fn excess(bundle: &Bundle, camera: usize) -> Option<f64> {
    let of = bundle.observations.iter().filter(|o| o.used && o.camera == camera);
    let lengths = of.map(|o| bundle.residual_px(o).map_or(f64::INFINITY, |r| r.length() / o.sigma_px));
    median(lengths).map(|length| length / MEDIAN)
}

/// Marks outliers, camera by camera; a wand that fewer than two cameras still see takes no part. The number of
/// observations that take none.
fn mark(bundle: &mut Bundle) -> usize {
    let mut excesses: Vec<f64> = (0..bundle.cameras.len())
        .map(|camera| excess(bundle, camera).filter(|excess| excess.is_finite()).unwrap_or(1.0).max(1.0))
        .collect();
    // A camera that cannot move and fits far worse than the others that cannot is not where it is said to be.
    let stays = |camera: &usize| !bundle.cameras[*camera].free.contains(&Parameter::Translation(0));
    let staying: Vec<usize> = (0..bundle.cameras.len()).filter(stays).collect();
    let usual = median(staying.iter().map(|&camera| excesses[camera])).unwrap_or(1.0);
    for camera in staying {
        excesses[camera] = excesses[camera].min(ELSEWHERE * usual);
    }
    let limits: Vec<f64> = excesses.iter().map(|excess| OUTLIER * excess).collect();
    let used: Vec<bool> = bundle
        .observations
        .iter()
        .map(|o| bundle.residual_px(o).is_some_and(|r| r.length() <= limits[o.camera] * o.sigma_px))
        .collect();
    // The cameras that see each placement: none, one, or more.
    let mut seen: Vec<(Option<usize>, bool)> = vec![(None, false); bundle.placements.len()];
    for (observation, _) in bundle.observations.iter().zip(&used).filter(|(_, used)| **used) {
        let (first, more) = &mut seen[observation.placement];
        *more |= first.get_or_insert(observation.camera) != &observation.camera;
    }
    for (observation, used) in bundle.observations.iter_mut().zip(used) {
        observation.used = used && seen[observation.placement].1;
    }
    bundle.observations.iter().filter(|o| !o.used).count()
}

/// Takes the standard deviations that were not given from the residuals; whether one changed by more than a twentieth.
fn learn(bundle: &mut Bundle, scatter: &mut [Scatter], inflation: f64) -> bool {
    let mut changed = false;
    for (camera, scatter) in scatter.iter_mut().enumerate().filter(|(_, scatter)| !scatter.known) {
        let Some(excess) = excess(bundle, camera).filter(|excess| excess.is_finite()) else { continue };
        let sigma_px = (scatter.sigma_px * excess * inflation).max(0.01);
        changed |= (sigma_px / scatter.sigma_px).ln().abs() > 0.05;
        for observation in bundle.observations.iter_mut().filter(|o| o.camera == camera) {
            let extra = (observation.sigma_px.powi(2) - scatter.sigma_px.powi(2)).max(0.0);
            observation.sigma_px = (extra + sigma_px * sigma_px).sqrt();
        }
        scatter.sigma_px = sigma_px;
    }
    changed
}
