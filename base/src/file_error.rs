//! A file that could not be read or written.

use std::{
    io,
    path::{Path, PathBuf},
};

use crate::ending::place_of;

/// A file or folder that could not be read or written: what was being done, to which, why, and what helps where the
/// kind of error tells it. The error enums of the rooms wrap it.
#[derive(Debug, thiserror::Error)]
#[error("cannot {doing} {}: {source}{}", path.display(), remedy(source))]
pub struct FileError {
    /// What was being done, with the noun before the path where that helps: `read`, `write image`, `list the folder`.
    pub doing: &'static str,
    /// The file or folder.
    pub path: PathBuf,
    /// The system's answer.
    pub source: io::Error,
}

impl FileError {
    /// Makes an error of the system's answer, for `map_err`: `File::open(path).map_err(FileError::when("read", path))`. What lies in a
    /// folder that is not whole yet is named by [where it will be](crate::ending::place_of).
    pub fn when(doing: &'static str, path: &Path) -> impl Fn(io::Error) -> Self {
        move |source| Self { doing, path: place_of(path), source }
    }
}

/// Copies a file, and makes the folder of the copy where needed. The error names which of the two it is about.
///
/// # Errors
/// If `from` cannot be read or `to` cannot be written.
pub fn copy_file(from: &Path, to: &Path) -> Result<(), FileError> {
    std::fs::File::open(from).map_err(FileError::when("read", from))?;
    let write = FileError::when("write", to);
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).map_err(&write)?;
    }
    std::fs::copy(from, to).map_err(write)?;
    Ok(())
}

/// What helps, with what separates it from the answer; nothing where the kind does not tell.
fn remedy(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::NotFound => "; check the path",
        io::ErrorKind::PermissionDenied => "; check the permissions of the file and of its folder",
        io::ErrorKind::ReadOnlyFilesystem => "; choose a place that can be written",
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "; free some space, or choose another disk",
        io::ErrorKind::FileTooLarge => {
            "; the disk or `ulimit -f` has no place for so large a file: choose another disk"
        }
        io::ErrorKind::NotADirectory => "; a part of the path is a file, not a folder",
        io::ErrorKind::IsADirectory => "; it is a folder, not a file",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_says_what_was_done_to_which_file_why_and_what_helps() {
        let message =
            |doing, kind: io::ErrorKind| FileError::when(doing, Path::new("a/b.png"))(kind.into()).to_string();
        assert_eq!(
            message("read image", io::ErrorKind::NotFound),
            "cannot read image a/b.png: entity not found; check the path"
        );
        assert_eq!(
            message("write", io::ErrorKind::StorageFull),
            "cannot write a/b.png: no storage space; free some space, or choose another disk"
        );
        assert_eq!(message("read", io::ErrorKind::BrokenPipe), "cannot read a/b.png: broken pipe");
    }
}
