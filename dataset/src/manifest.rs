//! The manifest of a dataset.

use std::{collections::BTreeMap, path::PathBuf};

use serde::{Deserialize, Serialize};

use super::{BodiesFile, layout};
use erfgs_scene::{Intrinsics, Modality, Pose, ply::PointCloud, rig_file::Sigma};

/// What a viewpoint is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// The trainer sees it.
    Train,
    /// Held out: evaluation alone may read it.
    Test,
}

/// One frame of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Image file, relative to the dataset's folder.
    pub file: PathBuf,
    /// The time that the frame is labelled with, nanoseconds on the session clock.
    pub t_ns: i64,
    /// `[start, end]` of the exposure, nanoseconds; equal where the frame is an instant.
    pub exposure_ns: [i64; 2],
    /// Mask of moving pixels (white = moving), relative to the dataset's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<PathBuf>,
}

/// The events of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraEvents {
    /// Event file, relative to the dataset's folder.
    pub file: PathBuf,
    /// How many events it holds.
    pub count: u64,
    /// Nominal contrast threshold of ON events, in natural-log intensity.
    pub threshold_on: f64,
    /// Nominal contrast threshold of OFF events, in natural-log intensity.
    pub threshold_off: f64,
    /// Below this grey level (of 255) the sensor responds linearly, above it logarithmically. v2e's "lin-log" uses 20.
    pub lin_log_threshold: f64,
    /// Whether intensity was linearised (sRGB to linear light) before the logarithm.
    #[serde(default)]
    pub linear_light: bool,
    /// `[first, last]` time covered, nanoseconds on the session clock. Event times in the file are microseconds on it.
    pub covers_ns: [i64; 2],
    /// The simulator's parameters, where the events were simulated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulator: Option<serde_json::Value>,
}

/// One viewpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Name, unique in the dataset; also the folder of its images.
    pub name: String,
    /// What it recorded.
    pub modality: Modality,
    /// What it is for.
    pub split: Split,
    /// Intrinsics of its images and events.
    pub intrinsics: Intrinsics,
    /// Where it stood.
    pub world_to_camera: Pose,
    /// How sure that is, where its calibration tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_sigma: Option<PoseSigma>,
    /// Standard deviation of what the times of all its frames are off by, seconds, where its calibration tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock_sigma_s: Option<f64>,
    /// Frames, ordered by time; empty for an event camera.
    #[serde(default)]
    pub frames: Vec<Frame>,
    /// Events; absent for an RGB camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub events: Option<CameraEvents>,
}

/// Standard deviations of a camera's pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseSigma {
    /// Of its centre, along the world's axes, metres.
    pub centre_m: [f64; 3],
    /// Of turns about its axes, degrees.
    pub rotation_deg: [f64; 3],
}

impl PoseSigma {
    /// Those of a calibration; none where it could not tell each of them.
    #[must_use]
    pub fn calibrated(sigma: &Sigma) -> Option<Self> {
        let all = |of: [Option<f64>; 3]| Some([of[0]?, of[1]?, of[2]?]);
        Some(Self { centre_m: all(sigma.centre_m)?, rotation_deg: all(sigma.rotation_deg)? })
    }

    /// With errors besides that have standard deviations of their own, which are the same along and about all axes.
    #[must_use]
    pub fn with(&self, centre_m: f64, rotation_deg: f64) -> Self {
        Self {
            centre_m: self.centre_m.map(|sigma| sigma.hypot(centre_m)),
            rotation_deg: self.rotation_deg.map(|sigma| sigma.hypot(rotation_deg)),
        }
    }
}

/// Where the recording came from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// What was imported: `panoptic`, `neu3d`, `nvidia`, `nerfstudio`, `colmap`, `stage`, `session`.
    pub importer: String,
    /// The name of the source folder or file (its last component).
    pub name: String,
    /// The importer's options, as given.
    #[serde(default)]
    pub options: BTreeMap<String, serde_json::Value>,
    /// Where time 0 of the dataset is on the clock of the session that it is of, nanoseconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zero_ns: Option<i64>,
    /// Version of erfgs that wrote the manifest.
    pub erfgs: String,
}

/// One step that made this dataset from another: `subsample`, `blur`, `event_only`, `simulate`, `undistort`,
/// `disturb`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariantStep {
    /// Name of the step.
    pub step: String,
    /// Its parameters.
    pub parameters: BTreeMap<String, serde_json::Value>,
}

impl VariantStep {
    /// Name of the step that keeps each n-th frame of the training cameras, and that of its parameter n.
    const SUBSAMPLE: [&str; 2] = ["subsample", "every"];

    /// Name of the step that averages frames of the training cameras: exposures that it makes may overlap.
    pub const BLUR: &str = "blur";

    /// The step that kept each `every`-th frame of the training cameras.
    #[must_use]
    pub fn subsample(every: u32) -> Self {
        let [step, parameter] = Self::SUBSAMPLE.map(str::to_owned);
        Self { step, parameters: [(parameter, every.into())].into() }
    }
}

/// The initial point cloud.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointCloudFile {
    /// PLY file, relative to the dataset's folder: x, y, z (metres), red, green, blue.
    pub file: PathBuf,
    /// How many points it holds.
    pub count: u64,
    /// How it was made.
    pub method: String,
    /// The parameters of the method.
    #[serde(default)]
    pub parameters: BTreeMap<String, serde_json::Value>,
}

/// Points in a row, in the order of the file, that belong to one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointRun {
    /// The instant that they were first seen at, nanoseconds on the session clock.
    pub t_ns: i64,
    /// Whether they were found again at another instant: such points stand still.
    pub found_again: bool,
    /// Whether they are known to lie on something that moves, which was there at `t_ns`.
    #[serde(default)]
    pub moving: bool,
    /// How many there are.
    pub count: u64,
}

impl PointCloudFile {
    /// How a manifest names a cloud in its usual file.
    pub(crate) fn of(cloud: &PointCloud, method: &str, parameters: BTreeMap<String, serde_json::Value>) -> Self {
        Self { file: layout::POINTS.into(), count: cloud.len() as u64, method: method.to_owned(), parameters }
    }

    /// The parameter that holds the [`PointRun`]s of the file.
    pub const RUNS: &str = "runs";

    /// The runs of points that share an instant, in the order of the file; `None` where the cloud came without.
    ///
    /// # Errors
    /// Where the parameter `runs` is no list of runs, with the reason.
    pub fn runs(&self) -> Result<Option<Vec<PointRun>>, String> {
        let Some(value) = self.parameters.get(Self::RUNS) else { return Ok(None) };
        let runs: Vec<PointRun> = serde_json::from_value(value.clone()).map_err(|error| error.to_string())?;
        let total = runs.iter().try_fold(0_u64, |total, run| total.checked_add(run.count));
        match total {
            Some(total) if total == self.count => Ok(Some(runs)),
            _ => Err(format!("the runs do not add up to the {} points of the file", self.count)),
        }
    }
}

/// What `dataset.json` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Always `erfgs-dataset`.
    pub format: String,
    /// Version of the format; this program writes and reads [`Manifest::VERSION`].
    pub version: u32,
    /// A short name for reports.
    pub name: String,
    /// Where the recording came from.
    pub provenance: Provenance,
    /// `[first, last]` instant of the recording, nanoseconds on the session clock. The trainer maps it to [0, 1].
    pub span_ns: [i64; 2],
    /// The seed of everything random in making the dataset.
    #[serde(default)]
    pub seed: u64,
    /// The steps that made it from the import, in order.
    #[serde(default)]
    pub variant: Vec<VariantStep>,
    /// Whether a frame's exposure gathered linear light, as a camera's does (true), or is a mean of display values, as
    /// blur simulated from video usually is (false).
    #[serde(default)]
    pub linear_exposure: bool,
    /// The initial point cloud, where made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<PointCloudFile>,
    /// What moves as bodies, where found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bodies: Option<BodiesFile>,
    /// All viewpoints.
    pub cameras: Vec<Camera>,
    /// SHA-256 (hexadecimal) of every file that the manifest names, by its path.
    #[serde(default)]
    pub sha256: BTreeMap<PathBuf, String>,
}

impl Manifest {
    /// The version of the format.
    pub const VERSION: u32 = 1;
    /// The value of [`Manifest::format`].
    pub const FORMAT: &str = "erfgs-dataset";
}

/// A manifest and the folder it describes.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// The folder.
    pub root: PathBuf,
    /// The manifest.
    pub manifest: Manifest,
}

impl Manifest {
    /// Of how many source frames one is kept, over all steps that made this dataset; 1 where all are.
    #[must_use]
    pub fn subsampled(&self) -> u64 {
        let [step, parameter] = VariantStep::SUBSAMPLE;
        let steps = self.variant.iter().filter(|made| made.step == step);
        let kept = steps.filter_map(|made| made.parameters.get(parameter)?.as_u64());
        kept.fold(1, |all, every| all.saturating_mul(every.max(1)))
    }

    /// Whether frames are means of others, so that one of these may lie in the exposures of several frames.
    #[must_use]
    pub(crate) fn is_blurred(&self) -> bool {
        self.variant.iter().any(|made| made.step == VariantStep::BLUR)
    }
}

impl Dataset {
    /// The viewpoints of a split.
    pub fn cameras(&self, split: Split) -> impl Iterator<Item = &Camera> {
        self.manifest.cameras.iter().filter(move |camera| camera.split == split)
    }

    /// The viewpoint called `name`.
    #[must_use]
    pub fn camera(&self, name: &str) -> Option<&Camera> {
        self.manifest.cameras.iter().find(|camera| camera.name == name)
    }
}
