//! Files of other programs, read and written here alone: rigs as a whole ([`read`], [`write()`]), and what datasets take from
//! them beside ([`nerfstudio::Transforms`], [`llff::rows`]; COLMAP's models are in [`crate::colmap`]).
//!
//! What differs: pixel centres (ours and COLMAP's at half-integers; OpenCV's, ROS's and Kalibr's at integers), axes
//! (nerfstudio's and LLFF's cameras look along -z), and which lenses a format can hold. What a format has no place for is said,
//! never dropped in silence; a lens that it would distort differently is refused. Numbers in files may be anything: sides of
//! images, focal lengths and rotations are checked as they are read.

mod camera_yaml;
mod coefficients;
mod colmap;
mod error;
pub mod json;
mod kalibr;
pub mod llff;
mod losses;
pub mod nerfstudio;
mod notes;
mod opencv;
mod ros;
mod toml;
mod unit;
mod yaml;

use std::{
    collections::BTreeSet,
    fmt,
    path::{Path, PathBuf},
    str::FromStr,
};

use crate::{Distortion, Intrinsics};
use erfgs_base::names::FileNames;

pub use camera_yaml::read_intrinsics;
pub use error::ExchangeError;
pub use ros::CameraInfo;
pub use unit::Unit;

use self::unit::Found;
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
    /// caliscope's `camera_array.toml`.
    Caliscope,
    /// pose2sim's `Calib.toml`.
    Pose2sim,
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
            "caliscope" => Self::Caliscope,
            "pose2sim" => Self::Pose2sim,
            "rig" => Self::Rig,
            _ => {
                return Err(
                    "the formats are colmap, kalibr, opencv, ros, nerfstudio, llff, caliscope, pose2sim and rig".into(),
                );
            }
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
            Self::Caliscope => "caliscope camera_array.toml",
            Self::Pose2sim => "pose2sim Calib.toml",
            Self::Rig => "rig.json",
        })
    }
}

/// Writes a rig. What the format cannot hold comes back, a sentence for each. Names of cameras become names of files in what is
/// written, whatever characters they have.
///
/// # Errors
/// If there is no camera, two have the same name, one has no pose where the format needs one, its lens does not fit, or a file
/// cannot be written.
pub fn write(rig: &RigFile, format: Format, out: &Path) -> Result<Vec<String>, ExchangeError> {
    let mut names = BTreeSet::new();
    if rig.cameras.is_empty() {
        return Err(ExchangeError::Empty);
    }
    if let Some(twice) = rig.cameras.iter().find(|camera| !names.insert(camera.name.as_str())) {
        return Err(ExchangeError::SameName { name: twice.name.clone(), format });
    }
    if format == Format::Rig {
        return rig.write(out).map(|()| Vec::new()).map_err(ExchangeError::from);
    }
    let (rig, renamed) = named(rig);
    let mut lost = match format {
        Format::Colmap => colmap::write(&rig, out),
        Format::Kalibr => kalibr::write(&rig, out),
        Format::OpenCv => opencv::write(&rig, out),
        Format::Ros => ros::write(&rig, out),
        Format::Nerfstudio => nerfstudio::write(&rig, out),
        Format::Llff => llff::write(&rig, out),
        Format::Caliscope | Format::Pose2sim => toml::write(&rig, format, out),
        Format::Rig => Ok(Vec::new()),
    }?;
    lost.extend(renamed);
    Ok(lost)
}

/// The rig with names that can be those of files in one folder, and a sentence for each camera that is called differently then.
fn named(rig: &RigFile) -> (RigFile, Vec<String>) {
    let (mut rig, mut names, mut renamed) = (rig.clone(), FileNames::default(), Vec::new());
    for camera in &mut rig.cameras {
        let name = names.give(&camera.name);
        if name != camera.name {
            renamed.push(format!("{}: it is called {name} there", camera.name.escape_debug()));
        }
        camera.name = name;
    }
    (rig, renamed)
}

/// Reads a rig in any format, told by what is there: a folder with a COLMAP model or with YAML files of OpenCV or ROS, one
/// such file, a `camchain` (YAML), `transforms.json`, LLFF's array (`.npy`), caliscope's or pose2sim's TOML, or `rig.json`. What it says beyond a rig is in the
/// rig's warnings, a sentence for each.
///
/// # Errors
/// If it is none of them, malformed, or says what no camera has; if its lengths should be metres and hardly can be, and it does
/// not say its unit.
pub fn read(path: &Path) -> Result<RigFile, ExchangeError> {
    read_in(path, None)
}

/// As [`read`], of a file whose lengths are in `unit` where that is given: they come out in metres.
///
/// # Errors
/// As [`read`], and if the file says another unit.
pub fn read_in(path: &Path, unit: Option<Unit>) -> Result<RigFile, ExchangeError> {
    let mut rig = unit::in_metres(path, found(path)?, unit)?;
    let mut names = BTreeSet::new();
    let twice: BTreeSet<&str> =
        rig.cameras.iter().map(|camera| camera.name.as_str()).filter(|name| !names.insert(*name)).collect();
    let warnings: Vec<String> =
        twice.iter().take(10).map(|name| format!("several cameras are called {name}; rename all but one")).collect();
    rig.warnings.extend(warnings);
    Ok(rig)
}

/// What is in a file, or in a folder.
fn found(path: &Path) -> Result<Found, ExchangeError> {
    if path.is_dir() {
        let model = ["cameras.bin", "cameras.txt"].iter().any(|name| path.join(name).is_file());
        return if model { colmap::read(path).map(Found::new) } else { opencv::read(path) };
    }
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("yaml" | "yml") if opencv::is_camera(&yaml::load(path)?) => opencv::read_file(path),
        Some("yaml" | "yml") => kalibr::read(path),
        Some("npy") => llff::read(path).map(Found::new),
        Some("toml") => toml::read(path),
        _ if path.file_name().is_some_and(|name| name == "transforms.json") => nerfstudio::read(path).map(Found::new),
        _ => {
            let rig = RigFile::read(path)?;
            // It says whether its lengths are metres.
            let unit = rig.metric.then_some(Unit::Metre);
            Ok(Found { unit, ..Found::new(rig) })
        }
    }
}

/// The files of a format with one for each camera.
fn files(rig: &RigFile, out: &Path) -> Vec<PathBuf> {
    rig.cameras.iter().map(|camera| out.join(format!("{}.yaml", camera.name))).collect()
}

/// The camera's pose, which the format cannot do without.
fn pose(camera: &RigCamera, format: Format) -> Result<crate::Pose, ExchangeError> {
    camera.pose.ok_or_else(|| ExchangeError::NoPose { camera: camera.name.clone(), format })
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
            let used = coefficients::used(&k).len();
            let count = [4, 5, 8].into_iter().find(|count| *count >= used).unwrap_or(8);
            Lens::Brown(k[..count].to_vec())
        }
        Distortion::KannalaBrandt(k) => Lens::Fisheye(k),
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod unit_tests;
