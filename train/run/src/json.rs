//! The JSON files of a run, which are either the old ones or the new ones, never half of one.

use std::{io, path::Path};

use erfgs_base::{FileError, atomic};

use serde::{Serialize, de::DeserializeOwned};

use super::RunError;

/// Writes `bytes` to `path` in one step: to a file beside it first, which then takes its place. Folders are made as
/// needed.
///
/// # Errors
/// [`RunError::File`].
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), RunError> {
    Ok(atomic::write(path, bytes).map_err(FileError::when("write", path))?)
}

/// Writes `value` as indented JSON, in one step.
pub(super) fn write_json<T: Serialize>(path: &Path, what: &'static str, value: &T) -> Result<(), RunError> {
    let mut text = serde_json::to_string_pretty(value).map_err(|error| RunError::Malformed {
        path: path.to_owned(),
        what,
        message: error.to_string(),
        remedy: "train the run again",
    })?;
    text.push('\n');
    write_atomically(path, text.as_bytes())
}

/// Reads a JSON file. `hint` says what to do when it is not there, `remedy` when it is damaged.
pub(super) fn read_json<T: DeserializeOwned>(
    path: &Path,
    what: &'static str,
    hint: &'static str,
    remedy: &'static str,
) -> Result<T, RunError> {
    let text = read_text(path, hint)?;
    serde_json::from_str(&text).map_err(|error| RunError::Malformed {
        path: path.to_owned(),
        what,
        message: error.to_string(),
        remedy,
    })
}

/// Reads a text file.
pub(super) fn read_text(path: &Path, hint: &'static str) -> Result<String, RunError> {
    erfgs_base::text::read(path).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => RunError::Missing { path: path.to_owned(), hint },
        _ => FileError::when("read", path)(source).into(),
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_is_replaced_whole_and_nothing_is_left_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.json");
        write_atomically(&path, b"first, and longer").unwrap();
        write_atomically(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(folder.path().join("a")).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_in_the_way_is_an_error_that_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("taken");
        fs::create_dir(&path).unwrap();
        let message = write_atomically(&path, b"x").unwrap_err().to_string();
        assert!(message.contains("taken"), "{message}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no part file stays behind");
    }
}
