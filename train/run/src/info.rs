//! `run.json`: what ran.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Something that the trainer did not do because the scene does not need it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LeftOut {
    /// What was left out, for instance `deformation of static Gaussians`.
    pub what: String,
    /// Why the scene does not need it.
    pub why: String,
    /// What that saved, with units, for instance `61 % of field time`.
    pub saves: String,
}

impl std::fmt::Display for LeftOut {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {} (saves {})", self.what, self.why, self.saves)
    }
}

/// How a camera shows colours, as training found it: `gain * scene + offset`, in display values (0 to 1); red, green, blue.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraColour {
    /// The camera's name in the dataset.
    pub camera: String,
    /// Gains.
    pub gain: [f32; 3],
    /// Offsets.
    pub offset: [f32; 3],
}

/// Where a camera was found to stand, beside its calibration: at (exp(turn) R, exp(turn) t + shift), where that says (R, t).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraPose {
    /// The camera's name in the dataset.
    pub camera: String,
    /// The turn, degrees, about the camera's axes.
    pub turn_degrees: [f64; 3],
    /// The shift, metres, along the camera's axes.
    pub shift_m: [f64; 3],
    /// How far its picture moved, pixels: root mean square, at the scene's depth.
    pub moved_px: f64,
}

/// When a camera was found to have taken its frames, or an event camera to have seen its events.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraTime {
    /// The camera's name in the dataset.
    pub camera: String,
    /// How much later than they say, milliseconds.
    pub late_ms: f64,
}

/// What `run.json` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunInfo {
    /// Always `erfgs-run`.
    pub format: String,
    /// Version of the run folder's format; this program writes and reads [`RunInfo::FORMAT_VERSION`].
    pub format_version: u32,
    /// `4dgs` or `erf-gs`.
    pub method: String,
    /// The preset that the configuration started from: `paper`, `released-code`, `default`.
    pub preset: String,
    /// The dataset's folder, as it was opened.
    pub dataset: PathBuf,
    /// The dataset's name.
    #[serde(default)]
    pub dataset_name: String,
    /// SHA-256 (hexadecimal) of the dataset's manifest: runs with the same value saw the same data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dataset_sha256: Option<String>,
    /// Name of the graphics adapter.
    pub adapter: String,
    /// Its driver, with version.
    pub driver: String,
    /// Version of erfgs.
    pub version: String,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// Minutes of training that the schedule follows, where it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub minutes: Option<f64>,
    /// Minutes of CPU time of training, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu_minutes: Option<f64>,
    /// SHA-256 (hexadecimal) of dataset, configuration, minutes and version ([`super::Identity`]): the same run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identity: Option<String>,
    /// Whether the training is over and everything that it writes is there.
    #[serde(default)]
    pub finished: bool,
    /// What was left out, why, and what that saved.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
    /// What the bodies are called that carry Gaussians, where any do.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<String>,
    /// How the training cameras show colours, where that was learned.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub camera_colours: Vec<CameraColour>,
    /// Where the cameras were found to stand, where that was learned.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub camera_poses: Vec<CameraPose>,
    /// When the cameras were found to have taken their frames, where that was learned.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub camera_times: Vec<CameraTime>,
}

impl RunInfo {
    /// The value of [`RunInfo::format`].
    pub const FORMAT: &str = "erfgs-run";
    /// The version of the format.
    pub const FORMAT_VERSION: u32 = 1;
}

impl Default for RunInfo {
    fn default() -> Self {
        Self {
            format: Self::FORMAT.into(),
            format_version: Self::FORMAT_VERSION,
            method: String::new(),
            preset: String::new(),
            dataset: PathBuf::new(),
            dataset_name: String::new(),
            dataset_sha256: None,
            adapter: String::new(),
            driver: String::new(),
            version: env!("CARGO_PKG_VERSION").into(),
            seed: 0,
            minutes: None,
            cpu_minutes: None,
            identity: None,
            finished: false,
            left_out: Vec::new(),
            bodies: Vec::new(),
            camera_colours: Vec::new(),
            camera_poses: Vec::new(),
            camera_times: Vec::new(),
        }
    }
}
