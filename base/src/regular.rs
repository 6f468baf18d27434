//! Files, and nothing that only looks like one.

use std::{io, path::Path};

/// Refuses what is there and is neither a file nor a folder: a pipe that nobody writes to is waited for without an end, and a device may
/// have none. What a shell hands over (`<(command)`, `/dev/stdin`, `/dev/null`) is taken.
///
/// # Errors
/// If it is one, or cannot be looked at.
pub fn check(path: &Path) -> io::Result<()> {
    if ["/dev/fd", "/dev/stdin", "/dev/null", "/proc/self/fd"].iter().any(|from_shell| path.starts_with(from_shell)) {
        return Ok(());
    }
    let found = path.metadata()?;
    if found.is_file() || found.is_dir() {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, "it is a pipe, a socket or a device, and no file"))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn files_and_folders_are_taken_and_nothing_that_never_ends() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link, pipe) = (folder.path().join("a"), folder.path().join("b"), folder.path().join("c"));
        std::fs::write(&file, b"x").unwrap();
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert!(check(&file).is_ok() && check(folder.path()).is_ok() && check(Path::new("/dev/null")).is_ok());
        for path in [link, pipe] {
            assert_eq!(check(&path).unwrap_err().kind(), io::ErrorKind::InvalidInput);
            assert_eq!(crate::text::read(&path).unwrap_err().kind(), io::ErrorKind::InvalidInput);
        }
        assert_eq!(check(&folder.path().join("none")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
