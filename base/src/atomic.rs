//! Files and folders that appear whole or not at all.

use std::{
    io::{self, Write},
    path::{Path, PathBuf},
};

/// Writes `bytes` to `path` through a temporary file in the same folder, which is renamed once it is on disk. Makes the
/// folder where needed.
///
/// # Errors
/// If the folder or the file cannot be written.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// As [`write()`], for content that `fill` produces.
///
/// # Errors
/// If the folder or the file cannot be written, or `fill` fails.
pub fn write_with(
    path: &Path,
    fill: impl FnOnce(&mut io::BufWriter<&std::fs::File>) -> io::Result<()>,
) -> io::Result<()> {
    try_write_with(path, fill, |error| error)
}

/// As [`write_with()`], for content whose making fails in ways of its own; `failed` says how it fails where the file does.
/// Gives what `fill` gives.
///
/// # Errors
/// If the folder or the file cannot be written, or `fill` fails.
pub fn try_write_with<T, E>(
    path: &Path,
    fill: impl FnOnce(&mut io::BufWriter<&std::fs::File>) -> Result<T, E>,
    failed: impl Fn(io::Error) -> E,
) -> Result<T, E> {
    let temporary = temporary(path).map_err(&failed)?;
    let mut writer = io::BufWriter::with_capacity(1 << 16, temporary.as_file());
    let filled = fill(&mut writer)?;
    writer.flush().map_err(&failed)?;
    drop(writer);
    temporary.as_file().sync_all().map_err(&failed)?;
    temporary.persist(path).map_err(|error| failed(error.error))?;
    Ok(filled)
}

/// A place beside `path` for a library that wants to make the file itself: to be persisted at `path` once it is whole,
/// removed when it is dropped before. Makes the folder where needed.
///
/// # Errors
/// If the folder cannot be written.
pub fn place(path: &Path) -> io::Result<tempfile::TempPath> {
    temporary(path).map(tempfile::NamedTempFile::into_temp_path)
}

/// A temporary file in the folder of `path`, which is made where needed.
fn temporary(path: &Path) -> io::Result<tempfile::NamedTempFile> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(folder)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".writing-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any new file, and not the 0600 of a temporary one.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

/// A folder that is being filled beside the place where it will appear whole. Dropped before that, it is removed.
#[derive(Debug)]
pub struct NewFolder {
    building: tempfile::TempDir,
    place: PathBuf,
}

impl NewFolder {
    /// Begins the folder that will be `place`, which must not exist yet or be an empty folder.
    ///
    /// # Errors
    /// Of kind [`io::ErrorKind::AlreadyExists`] if `place` is something else; others if nothing can be written there.
    pub fn begin(place: &Path) -> io::Result<Self> {
        if place.exists() && std::fs::read_dir(place).map_or(true, |mut entries| entries.next().is_some()) {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        let place = std::path::absolute(place)?;
        let parent = place.parent().unwrap_or(Path::new("/"));
        std::fs::create_dir_all(parent)?;
        let mut builder = tempfile::Builder::new();
        builder.prefix(".writing-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // As any new folder, and not the 0700 of a temporary one.
            builder.permissions(std::fs::Permissions::from_mode(0o777));
        }
        Ok(Self { building: builder.tempdir_in(parent)?, place })
    }

    /// Where to write until then.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.building.path()
    }

    /// Puts the folder in its place.
    ///
    /// # Errors
    /// If the place is taken by now or cannot be written.
    pub fn finish(self) -> io::Result<()> {
        if self.place.exists() {
            std::fs::remove_dir(&self.place)?;
        }
        std::fs::rename(self.building.path(), &self.place)?;
        // The folder has another name now, so that there is nothing left to remove.
        let _ = self.building.keep();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_whose_writer_fails_keeps_its_old_content() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.txt");
        write(&path, b"old").unwrap();
        let failed = write_with(&path, |file| {
            file.write_all(b"half")?;
            Err(io::Error::other("no more"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "no temporary file is left");
        write(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_folder_appears_when_it_is_finished_and_not_before() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("deep/ds");
        let begun = NewFolder::begin(&place).unwrap();
        std::fs::write(begun.path().join("a"), b"1").unwrap();
        assert!(!place.exists());
        drop(begun);
        assert_eq!(std::fs::read_dir(folder.path().join("deep")).unwrap().count(), 0);

        std::fs::create_dir(&place).unwrap();
        let begun = NewFolder::begin(&place).unwrap();
        std::fs::write(begun.path().join("a"), b"1").unwrap();
        begun.finish().unwrap();
        assert_eq!(std::fs::read(place.join("a")).unwrap(), b"1");
        assert_eq!(NewFolder::begin(&place).unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(NewFolder::begin(&place.join("a")).unwrap_err().kind(), io::ErrorKind::AlreadyExists);
    }
}
