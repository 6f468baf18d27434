//! Wand points that another program found.
//!
//! Two layouts are read: eWand's folders, and erfgs's own, which `docs/guide/wand.md` describes.

mod csv;
mod ewand;
mod own;

use std::path::Path;

use erfgs_base::FileError;

use super::{WandCamera, WandError};

/// Name of the file that makes a folder one of erfgs's own layout.
const OWN: &str = "wand.json";

/// Reads the wand points at `path`: a `wand.json`, a folder that holds one, or a folder in eWand's layout.
///
/// # Errors
/// If there are none, or a file cannot be read or understood; the message says which file and line.
pub fn read_points(path: &Path) -> Result<Vec<WandCamera>, WandError> {
    if path.is_file() {
        return own::read(path);
    }
    let own = path.join(OWN);
    if own.is_file() { own::read(&own) } else { ewand::read(path) }
}

fn read_text(path: &Path) -> Result<String, WandError> {
    Ok(erfgs_base::text::read(path).map_err(FileError::when("read", path))?)
}

fn malformed(path: &Path, line: Option<usize>, what: impl Into<String>) -> WandError {
    WandError::Malformed { path: path.into(), line, what: what.into() }
}
