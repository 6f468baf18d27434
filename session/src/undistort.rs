//! Datasets without lens distortion.

use std::path::Path;

use crate::{Dataset, dataset::DatasetError, progress::Progress};

/// Resamples frames, masks and events of every distorted camera to a pinhole of the same size and focal length, as a new
/// dataset in the folder `out`. The step is recorded in [`crate::Manifest::variant`] as `undistort`.
///
/// # Errors
/// If a file cannot be read or written, or a lens model cannot be inverted over the image.
pub fn undistort(dataset: &Dataset, out: &Path, progress: &mut dyn FnMut(Progress)) -> Result<Dataset, DatasetError> {
    progress(Progress { what: "cameras", done: 0, total: 0 });
    todo!("{dataset:?} {out:?}")
}
