//! eWand's layout: `frame_0.csv`, `frame_0.yaml`, `event_1.csv`, ... in one folder, in OpenCV's pixel convention.

use std::path::Path;

use erfgs_base::FileError;
use erfgs_scene::Modality;

use super::{super::WandCamera, WandError, csv};
use erfgs_scene::exchange::read_intrinsics;

/// Reads all cameras of the folder, in the order of their numbers.
pub fn read(folder: &Path) -> Result<Vec<WandCamera>, WandError> {
    let io = FileError::when("read the folder", folder);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(&io)? {
        let path = entry.map_err(&io)?.path();
        if let Some(number) = number(&path) {
            files.push((number, path));
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(WandError::NoPoints { folder: folder.into() });
    }
    files.into_iter().map(|(_, path)| camera(&path)).collect()
}

/// The number N of a file `*_N.csv`.
fn number(path: &Path) -> Option<u32> {
    let stem = path.file_name()?.to_str()?.strip_suffix(".csv")?;
    stem.rsplit_once('_')?.1.parse().ok()
}

fn camera(path: &Path) -> Result<WandCamera, WandError> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let modality = if name.starts_with("event") { Modality::Event } else { Modality::Rgb };
    let intrinsics = read_intrinsics(&path.with_extension("yaml"))?;
    let sightings = csv::read(path, ';', true, 0.5)?;
    Ok(WandCamera { name, modality, intrinsics, sigma_px: None, sightings })
}
