//! The `neu3d` layout.

use std::path::Path;

use super::{ImportError, ImportOptions};
use crate::{Dataset, progress::Progress};

/// Imports the recording in `source` into a new dataset in the folder `out`.
///
/// # Errors
/// If the source is incomplete or malformed, or the dataset cannot be written.
pub fn import(
    source: &Path,
    options: &ImportOptions,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Dataset, ImportError> {
    progress(Progress { what: "frames", done: 0, total: 0 });
    todo!("{source:?} {options:?} {out:?}")
}
