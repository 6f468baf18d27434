//! The pictures of a folder.

use std::path::{Path, PathBuf};

use erfgs_base::{FileError, order::order};

use super::ImageError;

/// Whether a file of this name is a picture that is read (PNG, JPEG), and not one that is hidden.
#[must_use]
pub fn is_picture(name: &str) -> bool {
    let extension = name.rsplit_once('.').map(|(_, extension)| extension.to_ascii_lowercase());
    !name.starts_with('.') && matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg"))
}

/// The pictures in a folder as frames that follow each other, by all numbers in their names.
///
/// # Errors
/// If the folder cannot be read, or nobody knows which of two comes first.
pub fn pictures(folder: &Path) -> Result<Vec<PathBuf>, ImageError> {
    let failed = |source| ImageError::from(FileError::when("read", folder)(source));
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if is_picture(&name) && path.is_file() {
            found.push(path);
        }
    }
    found.sort();
    let names: Vec<String> =
        found.iter().map(|path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned()).collect();
    let order =
        order(&names).map_err(|doubt| ImageError::Order { folder: folder.to_owned(), doubt: Box::new(doubt) })?;
    Ok(order.into_iter().map(|at| found[at].clone()).collect())
}
