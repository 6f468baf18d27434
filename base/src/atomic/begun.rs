//! Files and folders that are not whole yet. Each is locked while its process lives and named after it, so that what a process left that
//! was killed is known by the next one that writes into the same folder, and removed.

use std::{
    collections::BTreeSet,
    fs::{File, Metadata},
    io,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use tempfile::{NamedTempFile, TempDir};

use super::left::{Lock, Owner, is_left, is_shared, unwritten};
use crate::ending::Listed;

/// What everything that is not whole yet is called, and what intermediate files are.
pub(super) const PREFIX: &str = ".writing-";
/// Everything that a process which was killed may have left, by the beginning of its name.
const LEFT: [&str; 4] = [PREFIX, ".variant-", ".erfgs-disk-test-", crate::scratch::PREFIX];
/// A name is taken away by another process only in the instant between its making and its lock.
const TRIES: u32 = 8;

/// Who may see an unfinished file or folder.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Visibility {
    /// As any new file or folder.
    AsUsual,
    /// By this user alone.
    Privately,
}

/// A file that is not whole yet. Dropped, it is removed.
#[derive(Debug)]
pub(crate) struct BegunFile {
    pub file: NamedTempFile,
    listed: Listed,
}

impl BegunFile {
    /// Begins a file in a folder.
    pub fn new(folder: &Path, prefix: &str) -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        let prefix = format!("{prefix}{}", Owner::us().mark());
        builder.prefix(&prefix);
        #[cfg(unix)]
        builder.permissions(mode(0o666));
        let (file, listed) = locked(
            || Listed::make(|| builder.tempfile_in(folder), NamedTempFile::path),
            |(file, _)| Ok((file.path().to_owned(), file.as_file().try_clone()?)),
        )?
        .0;
        remove_left(folder, &file.as_file().metadata()?);
        Ok(Self { file, listed })
    }

    /// Puts the file in its place.
    pub fn persist(self, path: &Path) -> io::Result<()> {
        let Self { file, listed } = self;
        listed.finish(|| file.persist(path).map(drop).map_err(|error| error.error))
    }
}

/// A folder that is not whole yet. Dropped, it is removed.
#[derive(Debug)]
pub(crate) struct BegunFolder {
    folder: TempDir,
    listed: Listed,
    /// Keeps the lock.
    _handle: Option<File>,
}

impl BegunFolder {
    /// Begins a folder in another, which is made where needed. `place`: where it or what is in it will be, for errors.
    pub fn new(parent: &Path, prefix: &str, visibility: Visibility, place: Option<&Path>) -> io::Result<Self> {
        std::fs::create_dir_all(parent)?;
        let mut builder = tempfile::Builder::new();
        let prefix = format!("{prefix}{}", Owner::us().mark());
        builder.prefix(&prefix);
        #[cfg(unix)]
        builder.permissions(mode(match visibility {
            Visibility::AsUsual => 0o777,
            Visibility::Privately => 0o700,
        }));
        #[cfg(not(unix))]
        let _ = visibility;
        let ((folder, listed), handle) = locked(
            || Listed::make(|| builder.tempdir_in(parent), TempDir::path),
            |(folder, _)| Ok((folder.path().to_owned(), open_folder(folder.path())?)),
        )?;
        remove_left(parent, &folder.path().metadata()?);
        if let Some(place) = place {
            listed.becomes(place);
        }
        Ok(Self { folder, listed, _handle: handle })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Puts the folder in its place, where nothing is.
    pub fn persist(self, place: &Path) -> io::Result<()> {
        let Self { folder, listed, .. } = self;
        listed.finish(|| {
            std::fs::rename(folder.path(), place)?;
            // The folder has another name now, so that there is nothing left to remove.
            let _ = folder.keep();
            Ok(())
        })
    }
}

#[cfg(unix)]
fn mode(mode: u32) -> std::fs::Permissions {
    std::os::unix::fs::PermissionsExt::from_mode(mode)
}

#[cfg(unix)]
fn open_folder(path: &Path) -> io::Result<Option<File>> {
    File::open(path).map(Some)
}

/// Elsewhere folders cannot be opened as files.
#[cfg(not(unix))]
fn open_folder(_: &Path) -> io::Result<Option<File>> {
    Ok(None)
}

/// Makes something and locks it. A file system that knows no locks does without.
fn locked<T, H: Into<Option<File>>>(
    make: impl Fn() -> io::Result<T>,
    handle: impl Fn(&T) -> io::Result<(PathBuf, H)>,
) -> io::Result<(T, Option<File>)> {
    for _ in 0..TRIES {
        let made = make()?;
        let (path, handle) = handle(&made)?;
        let handle = handle.into();
        if handle.as_ref().is_none_or(|handle| lock(handle) != Lock::Another && is_at(handle, &path)) {
            return Ok((made, handle));
        }
    }
    Err(io::Error::new(io::ErrorKind::ResourceBusy, "another process removes what is begun"))
}

#[cfg(unix)]
fn lock(file: &File) -> Lock {
    use rustix::{
        fs::{FlockOperation, flock},
        io::Errno,
    };
    match flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Lock::Ours,
        Err(Errno::WOULDBLOCK) => Lock::Another,
        Err(_) => Lock::Unknown,
    }
}

#[cfg(not(unix))]
fn lock(_: &File) -> Lock {
    Lock::Unknown
}

/// Whether an open file or folder still is what lies at `path`.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let key = |found: Metadata| (found.dev(), found.ino());
    let (open, there) = (file.metadata().map(key), path.symlink_metadata().map(key));
    matches!((open, there), (Ok(open), Ok(there)) if open == there)
}

#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

#[cfg(unix)]
fn is_of_same_user(a: &Metadata, b: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    a.uid() == b.uid()
}

#[cfg(not(unix))]
fn is_of_same_user(_: &Metadata, _: &Metadata) -> bool {
    true
}

/// Removes what processes of this user left in a folder when they were killed; once for each folder, since folders may hold many
/// files. What cannot be removed stays: it is in nobody's way.
fn remove_left(folder: &Path, ours: &Metadata) {
    static LOOKED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let is_first = LOOKED.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    if is_first {
        remove_left_now(folder, ours);
    }
}

fn remove_left_now(folder: &Path, ours: &Metadata) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let rest = name.to_str().and_then(|name| LEFT.iter().find_map(|prefix| name.strip_prefix(prefix)));
        let Some(rest) = rest else { continue };
        let Ok(found) = entry.metadata() else { continue };
        // Links and pipes are nobody's that would be left.
        if !(found.is_file() || found.is_dir()) || !is_of_same_user(&found, ours) {
            continue;
        }
        let path = entry.path();
        // Some network's file systems lock what can be written alone.
        let handle =
            if found.is_dir() { File::open(&path) } else { File::options().read(true).write(true).open(&path) };
        let Ok(handle) = handle else { continue };
        let is_left = is_left(lock(&handle), is_shared(&handle), Owner::of(rest), unwritten(&found, ours));
        if !is_left || !is_at(&handle, &path) {
            continue;
        }
        let _ = if found.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn what_a_killed_process_left_goes_and_what_is_being_written_stays() {
        let folder = tempfile::tempdir().unwrap();
        let file = BegunFile::new(folder.path(), PREFIX).unwrap();
        let begun = BegunFolder::new(folder.path(), PREFIX, Visibility::AsUsual, None).unwrap();
        for prefix in LEFT {
            std::fs::write(folder.path().join(format!("{prefix}file")), b"half").unwrap();
            std::fs::create_dir_all(folder.path().join(format!("{prefix}folder/deep"))).unwrap();
            std::fs::write(folder.path().join(format!("{prefix}folder/deep/x")), b"half").unwrap();
        }
        std::fs::write(folder.path().join("kept.txt"), b"whole").unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        std::fs::write(elsewhere.path().join("kept.txt"), b"whole").unwrap();
        std::os::unix::fs::symlink(elsewhere.path(), folder.path().join(".writing-link")).unwrap();

        remove_left_now(folder.path(), &folder.path().metadata().unwrap());
        let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
        let mut expected =
            vec![name(file.file.path()), name(begun.path()), ".writing-link".into(), "kept.txt".to_owned()];
        expected.sort();
        assert_eq!(names(folder.path()), expected);
        assert_eq!(names(elsewhere.path()), ["kept.txt"]);

        file.persist(&folder.path().join("a")).unwrap();
        begun.persist(&folder.path().join("b")).unwrap();
        assert_eq!(names(folder.path()), [".writing-link", "a", "b", "kept.txt"]);
    }

    #[test]
    fn a_folder_is_looked_through_when_something_is_begun_in_it() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(".erfgs-disk-test-17"), b"half").unwrap();
        drop(BegunFile::new(folder.path(), PREFIX).unwrap());
        assert_eq!(names(folder.path()), [""; 0]);
    }
}
