//! Cameras that are calibrated already: they keep their poses, and the others are placed among them.
//!
//! A rig and a wand both say how long things are. They never agree quite, and both cannot hold while nothing may move: so
//! the wand is measured with the rig's own cameras, and either the rig takes the wand's scale or the wand the rig's.

use erfgs_scene::{Intrinsics, Pose};
use glam::DVec3;

use super::{Stick, WandCamera, WandError, WandOptions, held_out::locate, instants::Instant};
use crate::{bundle::BundleCamera, statistics::median};
use erfgs_scene::rig_file::{RigCamera, RigFile, Sigma};

/// A length less certain than this share of it takes no part in the scale.
const COARSE: f64 = 0.03;
/// Lengths farther from the median, in robust standard deviations, are outliers.
const OUTLIER: f64 = 4.0;
/// A rig and a wand that disagree by more than this share are reported.
const DISAGREE: f64 = 0.003;
/// A kept camera whose residuals are this many times the usual may have been moved.
const MOVED: f64 = 3.0;
/// Fewer lengths tell no scale.
const FEWEST: usize = 5;

/// Whose lengths hold where a rig's cameras keep their poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// The rig's, which must be metric; the wand's gaps keep their ratio.
    Rig,
    /// The wand's; the rig is made larger or smaller as a whole.
    Wand,
}

/// A rig whose cameras keep their poses and intrinsics.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownRig {
    /// The rig; its cameras with poses are kept.
    pub rig: RigFile,
    /// Whose lengths hold.
    pub scale: Scale,
}

impl KnownRig {
    /// A rig that keeps its lengths if it has any, and otherwise gets them from the wand.
    #[must_use]
    pub fn new(rig: RigFile) -> Self {
        let scale = if rig.metric { Scale::Rig } else { Scale::Wand };
        Self { rig, scale }
    }

    /// The entry of a camera that keeps its pose.
    pub(super) fn kept(&self, name: &str) -> Option<(&RigCamera, Pose)> {
        self.rig.camera(name).and_then(|camera| Some((camera, camera.pose?)))
    }

    /// Makes `rig`, which the wand gave, the whole rig: what is known of the kept cameras comes back, and those that took no
    /// part are added.
    pub(super) fn complete(&self, rig: &mut RigFile, fixed: &Fixed) {
        let factor = fixed.divisor(self);
        let scatter = |camera: &RigCamera| camera.rms_px.unwrap_or(0.0);
        let kept = rig.cameras.iter().filter(|c| self.kept(&c.name).is_some());
        let usual = median(kept.map(scatter)).unwrap_or(f64::INFINITY);
        for camera in &mut rig.cameras {
            let Some((known, _)) = self.kept(&camera.name) else { continue };
            let time_offset_s = camera.sigma.take().and_then(|sigma| sigma.time_offset_s);
            camera.sigma = shrunk_entry(known, factor).sigma.map(|sigma| Sigma { time_offset_s, ..sigma });
            if scatter(camera) > MOVED * usual || camera.outliers > camera.observations {
                let what =
                    "its observations of the wand contradict those of the rig's other cameras: has it been moved?";
                camera.warnings.push(what.into());
            }
        }
        for camera in self.rig.cameras.iter().filter(|camera| camera.pose.is_some()) {
            if rig.camera(&camera.name).is_none() {
                rig.cameras.push(shrunk_entry(camera, factor));
            }
        }
        let (Some(quality), Some(ratio)) = (&mut rig.quality, fixed.ratio.filter(|ratio| ratio.count > 0)) else {
            return;
        };
        quality.measures.insert("rig_length_over_wand".into(), ratio.value);
        quality.measures.insert("rig_length_over_wand_sigma".into(), ratio.sigma);
        let off = ratio.value - 1.0;
        if self.rig.metric && off.abs() > DISAGREE.max(4.0 * ratio.sigma) {
            rig.warnings.push(format!(
                "lengths of the rig differ from those of the wand by {:+.2} %: check the wand's gaps, and the origin of the rig's \
                 scale",
                100.0 * off
            ));
        }
    }

    pub(super) fn check(&self) -> Result<(), WandError> {
        if self.scale == Scale::Rig && !self.rig.metric {
            let what = "the rig has no scale of its own to keep; take it from the wand (--scale-from wand)";
            return Err(WandError::Option(what.into()));
        }
        Ok(())
    }
}

/// The rig's lengths over the wand's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ratio {
    /// The factor.
    pub value: f64,
    /// Its standard deviation, of the lengths' scatter.
    pub sigma: f64,
    /// From so many lengths.
    pub count: usize,
}

/// The poses that hold, one entry for each camera, in the units that the adjustment works in: metres of the wand or of the
/// rig. Without a rig, the reference camera is the world.
pub(super) struct Fixed {
    /// Where the cameras stand.
    pub poses: Vec<Option<Pose>>,
    /// The wand as long as the world says.
    pub stick: Stick,
    /// The rig's lengths over the wand's.
    pub ratio: Option<Ratio>,
}

impl Fixed {
    /// Without a rig.
    pub fn reference(count: usize, reference: usize, stick: Stick) -> Self {
        let poses = (0..count).map(|index| (index == reference).then_some(Pose::IDENTITY)).collect();
        Self { poses, stick, ratio: None }
    }

    /// With a rig: `offsets_s` are the cameras' time offsets as far as they are known, `sigma_px` what their LEDs scatter by.
    ///
    /// # Errors
    /// If the wand must give the scale and no two kept cameras measured it.
    pub fn of(
        known_rig: &KnownRig,
        cameras: &[WandCamera],
        offsets_s: &[f64],
        sigma_px: &[f64],
        instants: &[&Instant],
        options: &WandOptions,
    ) -> Result<Self, WandError> {
        let poses: Vec<Option<Pose>> =
            cameras.iter().map(|camera| known_rig.kept(&camera.name).map(|(_, pose)| pose)).collect();
        let mut ratio = ratio(&options.stick, cameras, &poses, offsets_s, sigma_px, instants);
        if ratio.is_none() && known_rig.scale == Scale::Wand {
            let what = "no two cameras of the rig saw the wand together often enough to take the scale from it; wave it \
                        where two of them see it";
            return Err(WandError::Option(what.into()));
        }
        let factor = ratio.get_or_insert(Ratio { value: 1.0, sigma: f64::INFINITY, count: 0 }).value;
        let [first, second] = options.stick.gaps_m();
        Ok(match known_rig.scale {
            Scale::Wand => Self {
                poses: poses.into_iter().map(|pose| pose.map(|pose| shrunk(&pose, factor))).collect(),
                stick: options.stick,
                ratio,
            },
            Scale::Rig => {
                let stick = Stick::new([first * factor, second * factor]).unwrap_or(options.stick);
                Self { poses, stick, ratio }
            }
        })
    }

    /// What the rig's lengths are divided by.
    pub fn divisor(&self, known_rig: &KnownRig) -> f64 {
        match (known_rig.scale, self.ratio) {
            (Scale::Wand, Some(ratio)) => ratio.value,
            _ => 1.0,
        }
    }
}

/// A pose of a rig that is made smaller by `factor`.
fn shrunk(pose: &Pose, factor: f64) -> Pose {
    Pose { translation: pose.translation / factor, ..*pose }
}

/// An entry of a rig that is made smaller by `factor`.
pub(super) fn shrunk_entry(camera: &RigCamera, factor: f64) -> RigCamera {
    let mut camera = camera.clone();
    camera.pose = camera.pose.map(|pose| shrunk(&pose, factor));
    if let Some(sigma) = &mut camera.sigma {
        sigma.centre_m = sigma.centre_m.map(|value| value.map(|metres| metres / factor));
    }
    camera
}

/// The whole wand as the kept cameras measure it, over what it is.
fn ratio(
    stick: &Stick,
    cameras: &[WandCamera],
    poses: &[Option<Pose>],
    offsets_s: &[f64],
    sigma_px: &[f64],
    instants: &[&Instant],
) -> Option<Ratio> {
    let known = |camera: usize, intrinsics: &Intrinsics| {
        poses[camera].map(|pose| BundleCamera {
            name: String::new(),
            intrinsics: *intrinsics,
            pose,
            time_offset_s: offsets_s[camera],
            free: Vec::new(),
        })
    };
    let known: Vec<Option<BundleCamera>> =
        cameras.iter().enumerate().map(|(index, camera)| known(index, &camera.intrinsics)).collect();
    let lengths = instants.iter().filter_map(|instant| {
        let [(first, first_covariance), (last, last_covariance)] =
            [locate(&known, sigma_px, instant, 0)?, locate(&known, sigma_px, instant, 2)?];
        let along: DVec3 = last - first;
        let length = along.length();
        let unit = along / length;
        let sigma = unit.dot((first_covariance + last_covariance) * unit).sqrt();
        (sigma < COARSE * length).then_some((length / stick.length_m(), sigma / stick.length_m()))
    });
    let mut lengths: Vec<(f64, f64)> = lengths.filter(|(length, _)| length.is_finite()).collect();
    if lengths.len() < FEWEST {
        return None;
    }
    let middle = median(lengths.iter().map(|(length, _)| *length))?;
    // The median of the absolute values of normal deviates is 0.6745.
    let spread = median(lengths.iter().map(|(length, sigma)| (length - middle).abs() / sigma))? / 0.6745;
    lengths.retain(|(length, sigma)| (length - middle).abs() <= OUTLIER * spread.max(1e-6) * sigma);
    let weight: f64 = lengths.iter().map(|(_, sigma)| sigma.powi(-2)).sum();
    let value = lengths.iter().map(|(length, sigma)| length * sigma.powi(-2)).sum::<f64>() / weight;
    let count = lengths.len();
    (value > 0.0 && value.is_finite()).then_some(Ratio { value, sigma: spread / weight.sqrt(), count })
}
