//! Names of recordings: plain names of session files in their folder, and nothing else of the disk.

use std::{
    fs, io,
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

use erfgs_base::calendar::DateTime;
use serde::Serialize;

/// Suffix of session files.
const SUFFIX: &str = ".mcap";

/// Why a name is refused.
#[derive(Debug, thiserror::Error)]
pub enum NameError {
    /// It could name something outside the folder, or something that is no session.
    #[error(
        "'{0}' cannot name a recording: use 1 to 100 letters, digits, '.', '-' and '_', not starting with '.' or '-'"
    )]
    Bad(String),
    /// There is no such session in the folder.
    #[error("there is no recording '{0}' in the folder")]
    Absent(String),
}

/// A session file in the folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RecordingFile {
    /// File name, without a folder.
    pub name: String,
    /// Its length, bytes.
    pub bytes: u64,
    /// When it was last written, seconds since 1970.
    pub modified_s: u64,
}

/// The session files of `folder`, the newest first; neither sub-folders nor links.
///
/// # Errors
/// If the folder cannot be read.
pub fn recordings(folder: &Path) -> io::Result<Vec<RecordingFile>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        // The type of the entry itself: a link is not followed.
        let (Ok(kind), Ok(name)) = (entry.file_type(), entry.file_name().into_string()) else { continue };
        if !kind.is_file() || !is_name(&name) || !name.ends_with(SUFFIX) {
            continue;
        }
        let Ok(about) = entry.metadata() else { continue };
        found.push(RecordingFile { name, bytes: about.len(), modified_s: about.modified().map_or(0, seconds) });
    }
    found.sort_by(|a, b| (b.modified_s, &b.name).cmp(&(a.modified_s, &a.name)));
    Ok(found)
}

/// The path of the existing session `name` in `folder`.
///
/// # Errors
/// If the name is not that of a plain session file in the folder itself.
pub(super) fn existing(folder: &Path, name: &str) -> Result<PathBuf, NameError> {
    if !is_name(name) || !name.ends_with(SUFFIX) {
        return Err(NameError::Bad(name.to_owned()));
    }
    let path = folder.join(name);
    match fs::symlink_metadata(&path) {
        Ok(about) if about.is_file() => Ok(path),
        _ => Err(NameError::Absent(name.to_owned())),
    }
}

/// The path for a new session: `name`, with the suffix where it lacks it, or one made of `rig` and the time.
///
/// # Errors
/// If the name could lead out of the folder.
pub(super) fn new(folder: &Path, name: &str, rig: &str, now: SystemTime) -> Result<PathBuf, NameError> {
    let name = match name.trim() {
        "" => unnamed(rig, now),
        given => given.strip_suffix(SUFFIX).unwrap_or(given).to_owned(),
    };
    if !is_name(&name) {
        return Err(NameError::Bad(name));
    }
    Ok(folder.join(name + SUFFIX))
}

/// The path for a new session that nobody named: made of `rig` and the time, with a number where that is taken.
pub(super) fn fresh(folder: &Path, rig: &str, now: SystemTime) -> PathBuf {
    let name = unnamed(rig, now);
    let numbered = (2_u32..).map(|number| format!("{name}-{number}{SUFFIX}"));
    let names = std::iter::once(format!("{name}{SUFFIX}")).chain(numbered).map(|name| folder.join(name));
    let mut last = folder.join(&name);
    for path in names {
        last = path;
        if fs::symlink_metadata(&last).is_err() {
            break;
        }
    }
    last
}

/// What a session is called that nobody named, without the suffix.
fn unnamed(rig: &str, now: SystemTime) -> String {
    format!("{rig}-{}", stamp(seconds(now)))
}

fn is_name(name: &str) -> bool {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'.' | b'-' | b'_');
    (1..=105).contains(&name.len()) && name.bytes().all(plain) && !name.starts_with(['.', '-'])
}

fn seconds(time: SystemTime) -> u64 {
    time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// `20260131-235959`, in UTC, of seconds since 1970.
fn stamp(seconds: u64) -> String {
    let DateTime { year, month, day, hour, minute, second } = DateTime::of_seconds(seconds.cast_signed());
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const OUTSIDE: [&str; 12] = [
        "..",
        ".",
        "../a.mcap",
        "a/../../b.mcap",
        "/etc/passwd",
        "a/b.mcap",
        "a\\b.mcap",
        ".hidden.mcap",
        "-rf.mcap",
        "a\0.mcap",
        "a b.mcap",
        "%2e%2e",
    ];

    #[test]
    fn names_that_lead_out_of_the_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        for name in OUTSIDE {
            assert!(matches!(existing(folder.path(), name), Err(NameError::Bad(_))), "{name:?}");
            assert!(matches!(new(folder.path(), name, "rig", UNIX_EPOCH), Err(NameError::Bad(_))), "{name:?}");
        }
        assert!(new(folder.path(), &"a".repeat(200), "rig", UNIX_EPOCH).is_err());
    }

    #[test]
    fn only_plain_session_files_of_the_folder_are_seen() {
        let (folder, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::write(folder.path().join("take.mcap"), b"12345").unwrap();
        fs::write(folder.path().join("notes.txt"), b"private").unwrap();
        fs::create_dir(folder.path().join("folder.mcap")).unwrap();
        fs::write(elsewhere.path().join("secret.mcap"), b"secret").unwrap();
        std::os::unix::fs::symlink(elsewhere.path().join("secret.mcap"), folder.path().join("link.mcap")).unwrap();
        let names: Vec<String> = recordings(folder.path()).unwrap().into_iter().map(|found| found.name).collect();
        assert_eq!(names, ["take.mcap"]);
        assert_eq!(existing(folder.path(), "take.mcap").unwrap(), folder.path().join("take.mcap"));
        for name in ["link.mcap", "folder.mcap", "absent.mcap"] {
            assert!(matches!(existing(folder.path(), name), Err(NameError::Absent(_))), "{name}");
        }
        assert!(matches!(existing(folder.path(), "notes.txt"), Err(NameError::Bad(_))));
    }

    #[test]
    fn recordings_without_a_name_are_called_by_rig_and_time() {
        let path =
            |name, seconds| new(Path::new("out"), name, "lab", UNIX_EPOCH + Duration::from_secs(seconds)).unwrap();
        assert_eq!(path("", 0), Path::new("out/lab-19700101-000000.mcap"));
        assert_eq!(path(" ", 951_782_399), Path::new("out/lab-20000228-235959.mcap"));
        assert_eq!(path("", 951_782_400), Path::new("out/lab-20000229-000000.mcap"));
        assert_eq!(path("", 1_798_761_599), Path::new("out/lab-20261231-235959.mcap"));
        assert_eq!(path("take-2.mcap", 0), Path::new("out/take-2.mcap"));
    }
}
