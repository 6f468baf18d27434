//! One process at a time in a folder.

use std::{
    fs::{File, OpenOptions, TryLockError},
    path::Path,
    time::{Duration, Instant},
};

use erfgs_base::FileError;

use super::RunError;

/// The file that is locked. It stays, empty.
const NAME: &str = ".lock";

/// Keeps others from working in a folder until it is dropped or the process ends, however it ends.
#[derive(Debug)]
pub struct FolderLock {
    _file: File,
}

impl FolderLock {
    /// What is left of a process whose machine is gone can keep a folder for so long.
    pub const PATIENCE: Duration = Duration::from_secs(120);

    /// Takes the folder, also from a process that soon lets go of it. `goes_on` is asked every so often whether that is still
    /// wanted; `None` if it is not, or another process has the folder for longer than [`Self::PATIENCE`].
    ///
    /// # Errors
    /// Those of [`FolderLock::take`].
    pub fn wait(folder: &Path, mut goes_on: impl FnMut() -> bool) -> Result<Option<Self>, RunError> {
        const LOOK_EVERY: Duration = Duration::from_millis(50);
        let from = Instant::now();
        loop {
            let lock = Self::take(folder)?;
            if lock.is_some() || !goes_on() || from.elapsed() > Self::PATIENCE {
                return Ok(lock);
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    /// Takes the folder for oneself, which is made where needed; `None` where another process has it. On a file system that
    /// knows no locks nobody is kept away.
    ///
    /// # Errors
    /// [`RunError::File`] if the folder cannot be written.
    pub fn take(folder: &Path) -> Result<Option<Self>, RunError> {
        let path = folder.join(NAME);
        std::fs::create_dir_all(folder).map_err(FileError::when("create the folder", folder))?;
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(&path);
        let file = file.map_err(FileError::when("open", &path))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Self { _file: file })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) if error.kind() == std::io::ErrorKind::Unsupported => {
                Ok(Some(Self { _file: file }))
            }
            Err(TryLockError::Error(error)) => Err(FileError::when("lock", &path)(error).into()),
        }
    }

    /// Whether a process has a folder now.
    #[must_use]
    pub fn is_taken(folder: &Path) -> bool {
        // A lock for reading, so that whoever looks keeps no other from looking, and nobody from working for longer than an
        // instant.
        let file = File::open(folder.join(NAME));
        file.is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_locked_by_one_until_it_lets_go() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        assert!(!FolderLock::is_taken(&run));
        let lock = FolderLock::take(&run).unwrap().unwrap();
        assert!(FolderLock::is_taken(&run));
        assert!(FolderLock::take(&run).unwrap().is_none());
        drop(lock);
        assert!(!FolderLock::is_taken(&run));
        assert!(FolderLock::take(&run).unwrap().is_some());
    }
}
