//! The host's disks.

use std::{
    io,
    path::{Path, PathBuf},
};

/// Space of the disk that a path lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiskSpace {
    /// Bytes that this user can still write.
    pub free: u64,
    /// Size of the file system, bytes.
    pub total: u64,
}

/// Space of the disk that `path`, or the closest folder above it that exists, lies on.
///
/// # Errors
/// If the file system does not answer.
pub fn disk_space(path: &Path) -> io::Result<DiskSpace> {
    #[cfg(unix)]
    {
        let stat = rustix::fs::statvfs(existing(path))?;
        Ok(DiskSpace { free: stat.f_bavail * stat.f_frsize, total: stat.f_blocks * stat.f_frsize })
    }
    #[cfg(not(unix))]
    Err(io::Error::new(
        io::ErrorKind::Unsupported,
        format!("the free space of '{}' is not known on this system", existing(path).display()),
    ))
}

/// `path`, or the closest folder above it that exists.
#[must_use]
pub fn existing(path: &Path) -> PathBuf {
    let above = path.ancestors().find(|above| above.exists() && !above.as_os_str().is_empty());
    above.unwrap_or(Path::new(".")).to_path_buf()
}

/// The folder that a file of this name lies in.
#[must_use]
pub fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
        _ => PathBuf::from("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn space_is_known_for_files_that_do_not_exist_yet() {
        let folder = tempfile::tempdir().unwrap();
        let space = disk_space(&folder.path().join("not/yet/here.mcap")).unwrap();
        assert!(space.free <= space.total && space.total > 0);
        assert_eq!(folder_of(Path::new("a.mcap")), Path::new("."));
    }
}
