//! Rigs in the formats of other programs, and back.
//!
//! What differs: pixel centres (ours and COLMAP's at half-integers; OpenCV's, ROS's and Kalibr's at integers), axes
//! (nerfstudio's and LLFF's cameras look along -z), and which lenses a format can hold. What a format has no place for is said,
//! never dropped in silence; a lens that it would distort differently is refused.

mod camera_yaml;
mod colmap;
mod error;
mod kalibr;
mod llff;
mod nerfstudio;
mod opencv;
mod ros;
mod yaml;

use std::{fmt, path::Path, str::FromStr};

use crate::{Distortion, Intrinsics};
pub use camera_yaml::read_intrinsics;
pub use error::ConvertError;

use crate::rig_file::{RigCamera, RigFile};

/// A format of another program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A COLMAP model (text) without points: a folder.
    Colmap,
    /// Kalibr's camchain: a YAML file.
    Kalibr,
    /// OpenCV's matrices, one YAML file for each camera in a folder.
    OpenCv,
    /// ROS's `camera_info`, one YAML file for each camera in a folder.
    Ros,
    /// nerfstudio's `transforms.json`.
    Nerfstudio,
    /// LLFF's `poses_bounds.npy`.
    Llff,
    /// Our own `rig.json`.
    Rig,
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Ok(match text {
            "colmap" => Self::Colmap,
            "kalibr" => Self::Kalibr,
            "opencv" => Self::OpenCv,
            "ros" => Self::Ros,
            "nerfstudio" => Self::Nerfstudio,
            "llff" => Self::Llff,
            "rig" => Self::Rig,
            _ => return Err("the formats are colmap, kalibr, opencv, ros, nerfstudio, llff and rig".into()),
        })
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Colmap => "COLMAP model",
            Self::Kalibr => "Kalibr camchain",
            Self::OpenCv => "OpenCV YAML",
            Self::Ros => "ROS camera_info",
            Self::Nerfstudio => "nerfstudio transforms.json",
            Self::Llff => "LLFF poses_bounds.npy",
            Self::Rig => "rig.json",
        })
    }
}

/// Writes a rig. What the format cannot hold comes back, a sentence for each.
///
/// # Errors
/// If a camera has no pose where the format needs one, its lens does not fit, or a file cannot be written.
pub fn write(rig: &RigFile, format: Format, out: &Path) -> Result<Vec<String>, ConvertError> {
    match format {
        Format::Colmap => colmap::write(rig, out),
        Format::Kalibr => kalibr::write(rig, out),
        Format::OpenCv => opencv::write(rig, out),
        Format::Ros => ros::write(rig, out),
        Format::Nerfstudio => nerfstudio::write(rig, out),
        Format::Llff => llff::write(rig, out),
        Format::Rig => rig.write(out).map(|()| Vec::new()).map_err(ConvertError::from),
    }
}

/// Reads a rig in any format but LLFF's, told by what is there: a folder with a COLMAP model or with YAML files of
/// OpenCV or ROS, one such file, a `camchain` (YAML), `transforms.json` or `rig.json`.
///
/// # Errors
/// If it is none of them, or malformed.
pub fn read(path: &Path) -> Result<RigFile, ConvertError> {
    if path.is_dir() {
        let model = ["cameras.bin", "cameras.txt"].iter().any(|name| path.join(name).is_file());
        return if model { colmap::read(path) } else { opencv::read(path) };
    }
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("yaml" | "yml") if opencv::is_camera(&yaml::load(path)?) => opencv::read_file(path),
        Some("yaml" | "yml") => kalibr::read(path),
        _ if path.file_name().is_some_and(|name| name == "transforms.json") => nerfstudio::read(path),
        _ => Ok(RigFile::read(path)?),
    }
}

/// The camera's pose, which the format cannot do without.
fn pose(camera: &RigCamera, format: Format) -> Result<crate::Pose, ConvertError> {
    camera.pose.ok_or_else(|| ConvertError::NoPose { camera: camera.name.clone(), format })
}

/// Coefficients of a lens without any, with four (k1, k2, p1, p2) or more, or of a fisheye.
enum Lens {
    None,
    Brown(Vec<f64>),
    Fisheye([f64; 4]),
}

fn lens(intrinsics: &Intrinsics) -> Lens {
    match intrinsics.distortion {
        Distortion::None => Lens::None,
        Distortion::BrownConrady(k) => {
            let used = k.iter().rposition(|value| *value != 0.0).map_or(0, |last| last + 1);
            let count = [4, 5, 8].into_iter().find(|count| *count >= used).unwrap_or(8);
            Lens::Brown(k[..count].to_vec())
        }
        Distortion::KannalaBrandt(k) => Lens::Fisheye(k),
    }
}

/// What every format but ours loses.
fn common_losses(rig: &RigFile, format: Format) -> Vec<String> {
    let mut lost = Vec::new();
    if rig.cameras.iter().any(|camera| camera.sigma.is_some()) {
        lost.push(format!("a {format} holds no uncertainties"));
    }
    if rig.cameras.iter().any(|camera| camera.time_offset_s != 0.0) {
        lost.push(format!("a {format} holds no time offsets of cameras"));
    }
    lost
}

#[cfg(test)]
mod tests;
