//! `poses_bounds.npy` of LLFF.
//!
//! N x 17 floats. The first 15 of a row are a 3 x 5 matrix, row by row: camera-to-world rotation with the columns
//! (down, right, backward), camera centre, and (height, width, focal length); the last two are near and far bounds,
//! which are not used. One focal length, centred principal point, no distortion.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::{ImportError, common};
use erfgs_base::npy::NpyArray;
use erfgs_scene::{Distortion, Intrinsics, Pose};

/// One row; the error is what is wrong with it, for the caller to add the camera's name.
pub(super) type Row = Result<(Intrinsics, Pose), String>;

/// Reads all rows.
pub(super) fn read(path: &Path) -> Result<Vec<Row>, ImportError> {
    let bytes = match std::fs::read(path) {
        Err(source) if source.kind() == std::io::ErrorKind::NotFound => {
            let remedy = "the folder must hold the poses that LLFF made";
            return Err(ImportError::Missing { path: path.to_owned(), remedy });
        }
        bytes => bytes.map_err(|source| ImportError::Io { doing: "read", path: path.to_owned(), source })?,
    };
    let npy = |source| ImportError::Npy { path: path.to_owned(), source };
    let array = NpyArray::decode(&bytes).map_err(npy)?;
    let [_, 17] = array.shape[..] else {
        let what = format!("the array has the shape {:?}, but [cameras, 17] is needed", array.shape);
        return Err(ImportError::Malformed { path: path.to_owned(), what });
    };
    Ok(array.floats().map_err(npy)?.as_chunks().0.iter().map(row).collect())
}

fn row(row: &[f64; 17]) -> Row {
    let matrix = row[..15].as_chunks::<5>().0;
    let column = |at: usize| DVec3::new(matrix[0][at], matrix[1][at], matrix[2][at]);
    let [down, right, backward, centre] = [0, 1, 2, 3].map(column);
    let [height, width, focal] = [0, 1, 2].map(|at| matrix[at][4]);
    let size = |length: f64| {
        (length >= 1.0 && length <= f64::from(u16::MAX) && length.fract() == 0.0).then_some(length as u32)
    };
    let (Some(width), Some(height)) = (size(width), size(height)) else {
        return Err(format!("the image size {width} x {height} in the poses is no size"));
    };
    if !(focal > 0.0 && focal.is_finite()) {
        return Err(format!("the focal length {focal} in the poses is not positive"));
    }
    let rotation = DMat3::from_cols(right, down, -backward).transpose();
    let pose = common::rigid(rotation, -(rotation * centre))?;
    let (cx, cy) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
    Ok((Intrinsics { width, height, fx: focal, fy: focal, cx, cy, distortion: Distortion::None }, pose))
}
