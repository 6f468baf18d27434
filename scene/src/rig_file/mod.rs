//! `rig.json`: the cameras of a rig, where they stand, and how well that is known.
//!
//! The format is documented in `docs/reference/rig-file.md`. Conventions are those of the whole program: world-to-camera poses in
//! metres with OpenCV axes, pixel centres at half-integers.

mod error;

use std::{collections::BTreeMap, path::Path};

use crate::{Intrinsics, Modality, Pose};
use erfgs_base::{
    FileError, atomic,
    plausible::{Implausible, OFFSET, SIGMA_PLACE, SIGMA_TIME, SIGMA_TURN},
};
use serde::{Deserialize, Serialize};

pub use error::RigFileError;

/// What `format` says.
const FORMAT: &str = "erfgs-rig";
/// The version that is written, and the newest that is read.
const VERSION: u32 = 1;

/// A calibrated rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RigFile {
    /// `erfgs-rig`.
    pub format: String,
    /// Version of the format.
    pub version: u32,
    /// How it was made: `board`, `wand`, `sfm`, `register`, or the format that it was converted from.
    pub method: String,
    /// Whether lengths are metres; a rig from images alone has no scale.
    pub metric: bool,
    /// Lenses of the cameras, and poses where they are known.
    pub cameras: Vec<RigCamera>,
    /// What the calibration as a whole says about itself; absent where it was converted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
    /// What a user should know before relying on it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// One camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RigCamera {
    /// Name, as in the recording.
    pub name: String,
    /// What it records.
    pub modality: Modality,
    /// Lens and sensor.
    pub intrinsics: Intrinsics,
    /// World-to-camera pose; absent where the intrinsics alone are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<Pose>,
    /// What to add to the camera's times to get the rig's, seconds.
    #[serde(default)]
    pub time_offset_s: f64,
    /// Standard deviations, where they are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Sigma>,
    /// Root mean square reprojection error, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_px: Option<f64>,
    /// Number of observations behind it, outliers excluded.
    #[serde(default)]
    pub observations: usize,
    /// Number of observations that were left out as outliers.
    #[serde(default)]
    pub outliers: usize,
    /// What is doubtful about this camera.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// Standard deviations of a camera. `null` in the file: not determined at all.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sigma {
    /// Intrinsics that were estimated, by name (`fx`, `cy`, `k1`), in their own unit.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub intrinsics: BTreeMap<String, Option<f64>>,
    /// The centre along the world's axes, metres.
    pub centre_m: [Option<f64>; 3],
    /// Turns about the camera's axes, degrees.
    pub rotation_deg: [Option<f64>; 3],
    /// Time offset, seconds, where it was estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_offset_s: Option<f64>,
}

impl Sigma {
    fn check(&self) -> Result<(), Implausible> {
        let known = |of: &[Option<f64>]| of.iter().copied().flatten().collect::<Vec<_>>();
        SIGMA_PLACE.check_all(known(&self.centre_m))?;
        SIGMA_TURN.check_all(known(&self.rotation_deg))?;
        SIGMA_TIME.check_all(self.time_offset_s)
    }
}

/// A calibration as a whole.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Root mean square reprojection error over all cameras, pixels.
    pub rms_px: f64,
    /// Sum of squared residuals in standard deviations over the degrees of freedom.
    pub variance_factor: f64,
    /// Measured coordinates minus determined parameters.
    pub degrees_of_freedom: usize,
    /// Condition number of the cameras' scaled matrix; `null` where something is not determined.
    pub condition: Option<f64>,
    /// What is not determined, in words; empty in a sound calibration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub open: Vec<String>,
    /// Measures of the method's own, such as held-out lengths; name to value, the unit in the name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub measures: BTreeMap<String, f64>,
}

impl RigFile {
    /// A rig of `cameras` made by `method`.
    #[must_use]
    pub fn new(method: &str, metric: bool, cameras: Vec<RigCamera>) -> Self {
        let (format, method) = (FORMAT.into(), method.into());
        Self { format, version: VERSION, method, metric, cameras, quality: None, warnings: Vec::new() }
    }

    /// Reads a rig.
    ///
    /// # Errors
    /// If the file cannot be read, is no rig file, is of a newer version, or holds numbers that make no sense.
    pub fn read(path: &Path) -> Result<Self, RigFileError> {
        let text = erfgs_base::text::read(path).map_err(FileError::when("read the rig file", path))?;
        let malformed = |what: String| RigFileError::Malformed { path: path.into(), what };
        let rig: Self = serde_json::from_str(&text).map_err(|error| malformed(error.to_string()))?;
        if rig.format != FORMAT {
            return Err(malformed(format!("its format is '{}', not '{FORMAT}'", rig.format)));
        }
        if rig.version > VERSION {
            return Err(RigFileError::Newer { path: path.into(), version: rig.version, known: VERSION });
        }
        for camera in &rig.cameras {
            camera.check().map_err(|what| malformed(format!("camera {}: {what}", camera.name)))?;
        }
        Ok(rig)
    }

    /// Writes the rig.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), RigFileError> {
        let io = FileError::when("write the rig file", path);
        let mut text = serde_json::to_vec_pretty(self).map_err(|error| io(error.into()))?;
        text.push(b'\n');
        Ok(atomic::write(path, &text).map_err(io)?)
    }

    /// Makes all lengths `factor` times as long: places and what is known of how sure they are.
    pub fn scale(&mut self, factor: f64) {
        for camera in &mut self.cameras {
            if let Some(pose) = &mut camera.pose {
                pose.translation *= factor;
            }
            if let Some(sigma) = &mut camera.sigma {
                sigma.centre_m = sigma.centre_m.map(|sigma| sigma.map(|sigma| factor * sigma));
            }
        }
    }

    /// The camera of this name.
    #[must_use]
    pub fn camera(&self, name: &str) -> Option<&RigCamera> {
        self.cameras.iter().find(|camera| camera.name == name)
    }
}

impl RigCamera {
    /// A camera of which nothing but this is known.
    #[must_use]
    pub fn new(name: &str, modality: Modality, intrinsics: Intrinsics, pose: Option<Pose>) -> Self {
        Self {
            name: name.into(),
            modality,
            intrinsics,
            pose,
            time_offset_s: 0.0,
            sigma: None,
            rms_px: None,
            observations: 0,
            outliers: 0,
            warnings: Vec::new(),
        }
    }

    fn check(&self) -> Result<(), Implausible> {
        self.intrinsics.checked()?;
        self.pose.map(Pose::checked).transpose()?;
        OFFSET.check(self.time_offset_s)?;
        self.sigma.as_ref().map_or(Ok(()), Sigma::check)
    }
}

#[cfg(test)]
mod tests {
    use crate::Distortion;

    use super::*;

    fn rig() -> RigFile {
        let intrinsics = Intrinsics {
            width: 640,
            height: 480,
            fx: 500.1,
            fy: 500.2,
            cx: 320.5,
            cy: 239.9,
            distortion: Distortion::BrownConrady([-0.1, 0.02, 1e-4, 2e-4, 0.0, 0.0, 0.0, 0.0]),
        };
        let mut camera = RigCamera::new("left", Modality::Rgb, intrinsics, Some(Pose::IDENTITY));
        camera.sigma = Some(Sigma { centre_m: [Some(1e-3), None, Some(0.1)], ..Sigma::default() });
        RigFile::new("board", true, vec![camera])
    }

    #[test]
    fn a_rig_comes_back_from_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.json");
        rig().write(&path).unwrap();
        assert_eq!(RigFile::read(&path).unwrap(), rig());
    }

    #[test]
    fn other_files_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.json");
        let mut newer = rig();
        newer.version = 2;
        newer.write(&path).unwrap();
        assert!(RigFile::read(&path).unwrap_err().to_string().contains("version 2"));
        let mut wrong = rig();
        wrong.cameras[0].intrinsics.fx = -1.0;
        wrong.write(&path).unwrap();
        let message = RigFile::read(&path).unwrap_err().to_string();
        assert!(message.contains("rig.json") && message.contains("camera left"), "{message}");
        std::fs::write(&path, "{\"format\": \"other\"").unwrap();
        assert!(matches!(RigFile::read(&path), Err(RigFileError::Malformed { .. })));
        assert!(matches!(RigFile::read(&folder.path().join("none.json")), Err(RigFileError::File(_))));
    }
}
