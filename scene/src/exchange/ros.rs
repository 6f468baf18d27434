//! ROS's `camera_info` as `camera_info_manager` and `camera_calibration` keep it: a YAML file for each camera. It describes one
//! camera and knows no poses; `rectification_matrix` and `projection_matrix` are those of a camera that is no part of a
//! rectified pair: the identity, and the camera matrix with a column of zeros.

use std::path::Path;

use erfgs_base::{FileError, atomic};

use super::{
    ExchangeError, Format,
    camera_yaml::{matrix, model, quoted},
    files, losses,
    yaml::list,
};
use crate::{
    Intrinsics,
    rig_file::{RigCamera, RigFile},
};

/// Tells a `camera_info` from the same matrices as OpenCV writes them.
pub(super) const OWN_KEY: &str = "projection_matrix";

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ExchangeError> {
    for (camera, path) in rig.cameras.iter().zip(files(rig, out)) {
        let io = |source| ExchangeError::from(FileError::when("write", &path)(source));
        atomic::write(&path, file(camera).as_bytes()).map_err(io)?;
    }
    let mut lost = losses::common(rig, Format::Ros);
    if rig.cameras.iter().any(|camera| camera.pose.is_some()) {
        lost.push("a ROS camera_info holds no poses; publish them as transforms (tf)".into());
    }
    Ok(lost)
}

/// The numbers of a ROS `CameraInfo`. The centre of the first pixel is (0, 0) there.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraInfo {
    /// `plumb_bob`, `rational_polynomial` or `equidistant`.
    pub model: &'static str,
    /// The model's coefficients, in OpenCV's order.
    pub coefficients: Vec<f64>,
    /// The camera matrix (K), row by row.
    pub matrix: [f64; 9],
    /// The projection matrix (P), row by row: the camera matrix with a column of zeros.
    pub projection: [f64; 12],
}

impl CameraInfo {
    /// A rectification (R) of a camera that is no part of a rectified pair.
    pub const RECTIFICATION: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    /// Of these intrinsics.
    #[must_use]
    pub fn new(intrinsics: &Intrinsics) -> Self {
        let (model, coefficients) = model(intrinsics);
        let k = matrix(intrinsics);
        let projection = [k[0], k[1], k[2], 0.0, k[3], k[4], k[5], 0.0, k[6], k[7], k[8], 0.0];
        Self { model, coefficients, matrix: k, projection }
    }
}

fn file(camera: &RigCamera) -> String {
    let i = &camera.intrinsics;
    let info = CameraInfo::new(i);
    let of = |name: &str, rows: usize, data: &[f64]| {
        format!("{name}:\n  rows: {rows}\n  cols: {}\n  data: {}\n", data.len() / rows, list(data))
    };
    let mut text =
        format!("image_width: {}\nimage_height: {}\ncamera_name: \"{}\"\n", i.width, i.height, quoted(&camera.name));
    text += &of("camera_matrix", 3, &info.matrix);
    text += &format!("distortion_model: {}\n", info.model);
    text += &of("distortion_coefficients", 1, &info.coefficients);
    text += &of("rectification_matrix", 3, &CameraInfo::RECTIFICATION);
    text += &of(OWN_KEY, 3, &info.projection);
    text
}
