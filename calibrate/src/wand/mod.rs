//! Calibration by wand: three LEDs on a stick, moved before cameras of either kind at any angle.
//!
//! A recorded session is looked through for the LEDs ([`look_session`]), or what was found elsewhere is read
//! ([`read_points`]). What the cameras saw ([`WandCamera`]) is matched in time (`instants.rs`). Each view alone places the wand (`view.rs`),
//! pairs of cameras are aligned by wands that both saw (`pair.rs`) and chained (`start.rs`), and one adjustment makes the
//! poses, focal lengths and time offsets what all observations say (`adjust.rs`). A fifth of the placements is held out of
//! it, and its lengths are measured with the result (`held_out.rs`). The wand's gaps make the rig metric. Cameras of a rig
//! that is calibrated already may keep their poses, and the others are placed among them (`known_rig.rs`).

mod adjust;
pub mod detect;
mod error;
mod held_out;
mod instants;
mod known_rig;
mod outcome;
mod pair;
mod place;
mod points;
mod select;
mod session;
mod sighting;
mod start;
mod stick;
mod view;

use erfgs_scene::Pose;

pub use error::WandError;
pub use instants::Matching;
pub use known_rig::{KnownRig, Scale};
pub use points::read_points;
pub use session::{Found, look_session, pictures};
pub use sighting::{Sighting, WandCamera};
pub use stick::Stick;

use adjust::Round;
use known_rig::Fixed;

use crate::{
    bundle::{
        Bundle, BundleCamera, Loss, Parameter,
        jackknife::{MOST_GROUPS, successive},
    },
    evidence::Evidence,
};
use erfgs_scene::rig_file::RigFile;

/// A camera needs so many placements that other cameras see too.
const NEEDED: usize = 5;

/// How a rig is calibrated by wand.
#[derive(Clone, Debug, PartialEq)]
pub struct WandOptions {
    /// The wand.
    pub stick: Stick,
    /// How sightings are matched in time.
    pub matching: Matching,
    /// The camera in whose space the world lies and to whose clock times are given; the first without it. With a `known`
    /// rig it stands for the clock alone, and is the first camera of the known rig without it.
    pub reference: Option<String>,
    /// A rig whose cameras keep their poses and intrinsics, and in whose space the world lies.
    pub known: Option<KnownRig>,
    /// Cameras that are left out.
    pub without: Vec<String>,
    /// Whether focal lengths stay as they are.
    pub fix_focal: bool,
    /// How well focal lengths are known beforehand, as a share of them.
    pub focal_sigma: f64,
    /// Whether cameras' time offsets are estimated.
    pub time_offsets: bool,
    /// The share of placements that is held out.
    pub hold_out: f64,
    /// At most so many placements are used.
    pub most: usize,
    /// Seed of random choices.
    pub seed: u64,
}

impl WandOptions {
    /// The defaults, for a wand.
    #[must_use]
    pub fn new(stick: Stick) -> Self {
        Self {
            stick,
            matching: Matching::default(),
            reference: None,
            known: None,
            without: Vec::new(),
            fix_focal: false,
            focal_sigma: 0.01,
            time_offsets: true,
            hold_out: 0.2,
            most: 1000,
            seed: 0,
        }
    }

    fn check(&self) -> Result<(), WandError> {
        let wrong = |what: &str| Err(WandError::Option(what.into()));
        if !(0.0..=0.8).contains(&self.hold_out) {
            return wrong("the share of placements that is held out must lie between 0 and 0.8");
        }
        if !(self.focal_sigma > 0.0 && self.focal_sigma.is_finite()) {
            return wrong("the standard deviation of focal lengths must be positive; to keep them, fix them");
        }
        if self.most < 10 {
            return wrong("fewer than 10 placements cannot make a calibration");
        }
        self.known.as_ref().map_or(Ok(()), KnownRig::check)
    }

    fn keeps(&self, camera: &str) -> bool {
        self.known.as_ref().is_some_and(|known_rig| known_rig.kept(camera).is_some())
    }
}

/// Calibrates a rig by what its cameras saw of a wand. The world is the reference camera's space, or that of the rig whose
/// cameras keep their poses; the result then holds all of its cameras that have a pose.
///
/// # Errors
/// If the observations cannot make a calibration; the error names what is missing.
pub fn calibrate(cameras: &[WandCamera], options: &WandOptions) -> Result<(RigFile, Evidence), WandError> {
    options.check()?;
    let cameras = chosen(cameras, options)?;
    let reference = match &options.reference {
        None => cameras.iter().position(|camera| options.keeps(&camera.name)).unwrap_or(0),
        Some(name) => cameras
            .iter()
            .position(|camera| camera.name == *name)
            .ok_or_else(|| WandError::Option(format!("there is no camera '{name}' to be the reference")))?,
    };
    let instants = instants::instants(&cameras, &options.stick, &options.matching);
    let instants = select::thin(instants, cameras.len(), options.most, options.seed);
    enough(&cameras, &select::counts(instants.iter(), cameras.len()), options)?;
    let held = select::hold_out(&instants, cameras.len(), options.hold_out, options.seed);
    let (held, kept): (Vec<_>, Vec<_>) = instants.iter().zip(held).partition(|(_, held)| *held);
    let (held, kept): (Vec<_>, Vec<_>) =
        (held.into_iter().map(|(i, _)| i).collect(), kept.into_iter().map(|(i, _)| i).collect());

    let mut scatter: Vec<_> = cameras.iter().map(|camera| adjust::Scatter::new(camera.sigma_px)).collect();
    let mut fixed = match &options.known {
        None => Fixed::reference(cameras.len(), reference, options.stick),
        Some(known_rig) => {
            Fixed::of(known_rig, &cameras, &vec![0.0; cameras.len()], &sigmas(&scatter), &kept, options)?
        }
    };
    let mut scaled = WandOptions { stick: fixed.stick, ..options.clone() };
    let poses = start::poses(&cameras, &kept, &fixed.poses, &scaled)?;
    let states = states(&cameras, &poses, &fixed, reference, options);
    let known: Vec<f64> = cameras.iter().map(|camera| camera.intrinsics.fx).collect();
    let mut evidence = Evidence::default();
    let mut bundle = adjust::adjust(&states, &known, &kept, &mut scatter, &scaled, Round::First, &mut evidence)?;
    let freed = |bundle: &Bundle| -> Vec<BundleCamera> {
        bundle.cameras.iter().zip(&states).map(|(c, s)| BundleCamera { free: s.free.clone(), ..c.clone() }).collect()
    };
    if let Some(known_rig) = &options.known {
        // Late stamps make lengths wrong, so that the scale is measured again when they are known.
        let offsets: Vec<f64> = bundle.cameras.iter().map(|camera| camera.time_offset_s).collect();
        let again = Fixed::of(known_rig, &cameras, &offsets, &sigmas(&scatter), &kept, options)?;
        let change = again.divisor(known_rig) / fixed.divisor(known_rig);
        let mut start = freed(&bundle);
        for (camera, pose) in start.iter_mut().zip(&again.poses) {
            camera.pose = pose.unwrap_or(Pose { translation: camera.pose.translation / change, ..camera.pose });
        }
        scaled.stick = again.stick;
        fixed = again;
        bundle = adjust::adjust(&start, &known, &kept, &mut scatter, &scaled, Round::Scaled, &mut evidence)?;
    }
    if !held.is_empty() {
        evidence.held_out = held_out::lengths(&scaled.stick, &bundle.cameras, &sigmas(&scatter), &held);
        let all: Vec<_> = instants.iter().collect();
        let start = freed(&bundle);
        bundle = adjust::adjust(&start, &known, &all, &mut scatter, &scaled, Round::All, &mut evidence)?;
    }
    enough(&cameras, &outcome::placements(&bundle), options)?;
    // What wands share that follow each other (the speed of a LED across the image, the lens where the wand was) is seen only
    // when they are left out together.
    let uncertainty = bundle.uncertainty_of_groups(Loss::Squared, &successive(bundle.placements.len(), MOST_GROUPS))?;
    let (mut rig, evidence) = outcome::outcome(&cameras, bundle, &uncertainty, &scatter, evidence, options)?;
    if let Some(known_rig) = &options.known {
        known_rig.complete(&mut rig, &fixed);
    }
    Ok((rig, evidence))
}

fn sigmas(scatter: &[adjust::Scatter]) -> Vec<f64> {
    scatter.iter().map(|scatter| scatter.sigma_px).collect()
}

/// The cameras that take part.
fn chosen(cameras: &[WandCamera], options: &WandOptions) -> Result<Vec<WandCamera>, WandError> {
    if let Some(name) = options.without.iter().find(|name| !cameras.iter().any(|camera| camera.name == **name)) {
        return Err(WandError::Option(format!("there is no camera '{name}' to leave out")));
    }
    let mut chosen: Vec<_> = cameras.iter().filter(|c| !options.without.contains(&c.name)).cloned().collect();
    let sees = |camera: &WandCamera| camera.sightings.iter().any(|s| s.leds.iter().any(Option::is_some));
    if let Some(known_rig) = &options.known {
        // A camera of the rig that did not see the wand needs none.
        chosen.retain(|camera| !options.keeps(&camera.name) || sees(camera));
        let mut kept = 0;
        for camera in &mut chosen {
            if let Some((known, _)) = known_rig.kept(&camera.name) {
                camera.intrinsics = known.intrinsics;
                kept += 1;
            }
        }
        if kept == 0 {
            return Err(WandError::NoneKept { cameras: chosen.into_iter().map(|camera| camera.name).collect() });
        }
        if kept == chosen.len() {
            return Err(WandError::Option("all cameras that saw the wand have a pose in the rig, and keep it".into()));
        }
    }
    if chosen.len() < 2 {
        return Err(WandError::TooFewCameras { cameras: chosen.len() });
    }
    let unseen: Vec<_> = chosen.iter().filter(|camera| !sees(camera)).map(|camera| camera.name.clone()).collect();
    if unseen.is_empty() { Ok(chosen) } else { Err(WandError::Unseen { cameras: unseen }) }
}

fn enough(cameras: &[WandCamera], counts: &[usize], options: &WandOptions) -> Result<(), WandError> {
    let few = |(camera, count): &(&WandCamera, &usize)| **count < NEEDED && !options.keeps(&camera.name);
    match cameras.iter().zip(counts).find(few) {
        Some((camera, &found)) => Err(WandError::TooFew { camera: camera.name.clone(), found, needed: NEEDED }),
        None => Ok(()),
    }
}

/// The cameras as the adjustment starts with them.
fn states(
    cameras: &[WandCamera],
    poses: &[Pose],
    fixed: &Fixed,
    reference: usize,
    options: &WandOptions,
) -> Vec<BundleCamera> {
    let state = |(index, (camera, pose)): (usize, (&WandCamera, &Pose))| {
        let mut free = Vec::new();
        if !options.fix_focal && !options.keeps(&camera.name) {
            free.push(Parameter::Focal);
        }
        if fixed.poses[index].is_none() {
            free.extend(Parameter::POSE);
        }
        if options.time_offsets && index != reference {
            free.push(Parameter::TimeOffset);
        }
        let (name, intrinsics) = (camera.name.clone(), camera.intrinsics);
        BundleCamera { name, intrinsics, pose: *pose, time_offset_s: 0.0, free }
    };
    cameras.iter().zip(poses).enumerate().map(state).collect()
}
