//! LLFF's `poses_bounds.npy`: N x 17 floats. The first 15 of a row are a 3 x 5 matrix, row by row: camera-to-world rotation with
//! the columns (down, right, backward), camera centre, and (height, width, focal length); the last two are near and far bounds
//! of the depth. One focal length, centred principal point, no distortion; cameras have no names.

use std::path::Path;

use crate::{Distortion, Intrinsics, Modality, Pose, camera::image_side};
use erfgs_base::{
    FileError, atomic,
    npy::{self, NpyArray},
};
use glam::{DMat3, DVec3};

use super::{ExchangeError, Format, losses, pose};
use crate::rig_file::{RigCamera, RigFile};

/// What every reader says of the bounds.
pub const BOUNDS_LEFT_OUT: &str = "the bounds of the depth in poses_bounds.npy are not taken";

/// One camera; the error is what is wrong with it, for the caller to add the camera's name.
pub type Row = Result<(Intrinsics, Pose), String>;

/// Reads all rows, in order.
///
/// # Errors
/// If the file cannot be read or is no array of 17 columns.
pub fn rows(path: &Path) -> Result<Vec<Row>, ExchangeError> {
    let bytes = std::fs::read(path).map_err(FileError::when("read", path))?;
    let npy = |source| ExchangeError::Npy { path: path.into(), source };
    let array = NpyArray::decode(&bytes).map_err(npy)?;
    let [_, 17] = array.shape[..] else {
        let what = format!("the array has the shape {:?}, but [cameras, 17] is needed", array.shape);
        return Err(ExchangeError::Malformed { path: path.into(), what });
    };
    Ok(array.floats().map_err(npy)?.as_chunks().0.iter().map(row).collect())
}

fn row(row: &[f64; 17]) -> Row {
    let matrix = row[..15].as_chunks::<5>().0;
    let column = |at: usize| DVec3::new(matrix[0][at], matrix[1][at], matrix[2][at]);
    let [down, right, backward, centre] = [0, 1, 2, 3].map(column);
    let [height, width, focal] = [0, 1, 2].map(|at| matrix[at][4]);
    let (Ok(width), Ok(height)) = (image_side(width), image_side(height)) else {
        return Err(format!("the image size {width} x {height} in the poses is no size"));
    };
    let rotation = DMat3::from_cols(right, down, -backward).transpose();
    let pose = Pose::rigid(rotation, -(rotation * centre))?;
    let (cx, cy) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
    let lens = Intrinsics { width, height, fx: focal, fy: focal, cx, cy, distortion: Distortion::None };
    Ok((lens.checked().map_err(|wrong| format!("in the poses {wrong}"))?, pose))
}

/// The file as a rig: cameras are called `cam00`, `cam01` and so on.
pub(super) fn read(path: &Path) -> Result<RigFile, ExchangeError> {
    let camera = |(index, row): (usize, Row)| {
        let name = format!("cam{index:02}");
        let (intrinsics, pose) =
            row.map_err(|what| ExchangeError::Camera { camera: name.clone(), path: path.into(), what })?;
        Ok(RigCamera::new(&name, Modality::Rgb, intrinsics, Some(pose)))
    };
    let cameras: Vec<RigCamera> =
        rows(path)?.into_iter().enumerate().map(camera).collect::<Result<_, ExchangeError>>()?;
    if cameras.is_empty() {
        return Err(ExchangeError::Malformed { path: path.into(), what: "it holds no poses".into() });
    }
    let mut rig = RigFile::new("llff", false, cameras);
    rig.warnings.extend([
        "a poses_bounds.npy names no cameras: they are numbered in its order".into(),
        "a poses_bounds.npy does not say whether its unit is the metre".into(),
        BOUNDS_LEFT_OUT.into(),
    ]);
    Ok(rig)
}

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ExchangeError> {
    let mut lost = losses::common(rig, Format::Llff);
    let poses = rig.cameras.iter().map(|camera| pose(camera, Format::Llff)).collect::<Result<Vec<_>, _>>()?;
    // Where the scene is nobody knows here: between a twentieth and twice the rig's extent.
    let extent = poses.iter().map(|pose| (pose.centre() - poses[0].centre()).length()).fold(0.0, f64::max).max(1.0);
    let mut values = Vec::with_capacity(17 * poses.len());
    for (camera, pose) in rig.cameras.iter().zip(&poses) {
        let i = &camera.intrinsics;
        let r = DMat3::from_quat(pose.rotation.conjugate());
        let (centre, size) = (pose.centre(), [f64::from(i.height), f64::from(i.width), 0.5 * (i.fx + i.fy)]);
        for row in 0..3 {
            values.extend([r.y_axis[row], r.x_axis[row], -r.z_axis[row], centre[row], size[row]]);
        }
        values.extend([0.05 * extent, 2.0 * extent]);
        let off = (i.cx - 0.5 * f64::from(i.width)).abs().max((i.cy - 0.5 * f64::from(i.height)).abs());
        if off > 0.01 || (i.fx - i.fy).abs() > 0.01 {
            lost.push(format!(
                "{}: one focal length and a centred principal point are all that LLFF holds",
                camera.name
            ));
        }
        if i.distortion != Distortion::None {
            lost.push(format!("{}: LLFF holds no distortion; undistort the images first", camera.name));
        }
    }
    lost.push("LLFF holds no names of cameras: they are in the rig's order".into());
    lost.push("the bounds of the depth are guessed from the rig's extent".into());
    let io = |source| ExchangeError::from(FileError::when("write", out)(source));
    atomic::write(out, &npy::encode(&[poses.len(), 17], values.into_iter())).map_err(io)?;
    Ok(lost)
}
