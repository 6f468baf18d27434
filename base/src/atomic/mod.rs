//! Files and folders that appear whole or not at all.

use std::{
    io::{self, Write},
    path::{Path, PathBuf},
};

pub(crate) mod begun;
mod left;
mod together;

use begun::{BegunFile, BegunFolder, PREFIX, Visibility};

pub use together::{Together, numbered};

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
    fill_and_place(path, fill, failed, |file| file.sync_all())
}

/// As [`try_write_with()`], without waiting for the disk: for pictures and other files of which there are many. They are whole
/// under their names however the process ends, but not if the machine loses its power.
///
/// # Errors
/// If the folder or the file cannot be written, or `fill` fails.
pub fn try_write_one_of_many<T, E>(
    path: &Path,
    fill: impl FnOnce(&mut io::BufWriter<&std::fs::File>) -> Result<T, E>,
    failed: impl Fn(io::Error) -> E,
) -> Result<T, E> {
    fill_and_place(path, fill, failed, |_| Ok(()))
}

/// Fills a file in the folder of `path`, which is made where needed, and puts it there once `settle` has seen it.
fn fill_and_place<T, E>(
    path: &Path,
    fill: impl FnOnce(&mut io::BufWriter<&std::fs::File>) -> Result<T, E>,
    failed: impl Fn(io::Error) -> E,
    settle: impl FnOnce(&std::fs::File) -> io::Result<()>,
) -> Result<T, E> {
    let (prepared, filled) = prepare(path, fill, &failed, settle)?;
    prepared.finish().map_err(failed)?;
    Ok(filled)
}

/// Fills a file in the folder of `path`, which is made where needed, and lets `settle` see it.
fn prepare<T, E>(
    path: &Path,
    fill: impl FnOnce(&mut io::BufWriter<&std::fs::File>) -> Result<T, E>,
    failed: impl Fn(io::Error) -> E,
    settle: impl FnOnce(&std::fs::File) -> io::Result<()>,
) -> Result<(Prepared, T), E> {
    let folder = folder_of(path);
    std::fs::create_dir_all(folder).map_err(&failed)?;
    let begun = BegunFile::new(folder, PREFIX).map_err(&failed)?;
    let mut writer = io::BufWriter::with_capacity(1 << 16, begun.file.as_file());
    let filled = fill(&mut writer)?;
    writer.flush().map_err(&failed)?;
    drop(writer);
    settle(begun.file.as_file()).map_err(failed)?;
    Ok((Prepared { begun, place: path.to_owned() }, filled))
}

/// A file that is written and not yet in its place: of several that belong together, all are written before one is seen. Dropped, it is
/// removed.
#[derive(Debug)]
pub struct Prepared {
    begun: BegunFile,
    place: PathBuf,
}

impl Prepared {
    /// Writes `bytes` beside `path`, whose folder is made where needed.
    ///
    /// # Errors
    /// If the folder or the file cannot be written.
    pub fn new(path: &Path, bytes: &[u8]) -> io::Result<Self> {
        let (prepared, ()) = prepare(path, |file| file.write_all(bytes), |error| error, |file| file.sync_all())?;
        Ok(prepared)
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// If its place cannot be written.
    pub fn finish(self) -> io::Result<()> {
        self.begun.persist(&self.place)
    }
}

/// The folder that a file lies in.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A place for a library or a program that wants to make a file itself: the file's own name, in a folder beside `path` that is
/// removed with what is in it unless the file is put in its place.
#[derive(Debug)]
pub struct Place {
    folder: BegunFolder,
    path: PathBuf,
    place: PathBuf,
}

impl Place {
    /// Begins the file that will be `path`. Makes the folder where needed.
    ///
    /// # Errors
    /// If the folder cannot be written, or `path` has no name of a file.
    pub fn begin(path: &Path) -> io::Result<Self> {
        let name = path.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "no name of a file"))?;
        let folder = BegunFolder::new(folder_of(path), PREFIX, Visibility::AsUsual, path.parent())?;
        Ok(Self { path: folder.path().join(name), folder, place: path.to_owned() })
    }

    /// Where to write until then.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts the file in its place once it is on disk.
    ///
    /// # Errors
    /// If the file is not there or its place cannot be written.
    pub fn finish(self) -> io::Result<()> {
        std::fs::File::open(&self.path)?.sync_all()?;
        std::fs::rename(&self.path, &self.place)?;
        drop(self.folder);
        Ok(())
    }
}

/// A file that is there while something is measured or tried in a folder, and never later.
#[derive(Debug)]
pub struct TrialFile(BegunFile);

impl TrialFile {
    /// Makes a file in `folder`, called `prefix` and some letters.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn new(folder: &Path, prefix: &str) -> io::Result<Self> {
        BegunFile::new(folder, prefix).map(Self)
    }

    /// The file.
    #[must_use]
    pub fn file(&self) -> &std::fs::File {
        self.0.file.as_file()
    }
}

/// A folder that is being filled beside the place where it will appear whole. Dropped before that, it is removed.
#[derive(Debug)]
pub struct NewFolder {
    building: BegunFolder,
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
        let absolute = std::path::absolute(place)?;
        let parent = absolute.parent().unwrap_or(Path::new("/"));
        let building = BegunFolder::new(parent, PREFIX, Visibility::AsUsual, Some(place))?;
        Ok(Self { building, place: absolute })
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
        self.building.persist(&self.place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FileError;

    #[test]
    fn errors_name_the_place_and_never_what_is_being_filled() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (new, together, video) = (at("deep/ds"), at("deep/film"), at("deep/a.mp4"));
        let begun =
            (NewFolder::begin(&new).unwrap(), Together::begin(&together).unwrap(), Place::begin(&video).unwrap());
        std::fs::create_dir(at("there")).unwrap();
        let there = Together::begin(&at("there")).unwrap();
        let refused = |path: &Path| FileError::when("write", path)(io::ErrorKind::StorageFull.into()).path;
        for (filled, place) in [
            (begun.0.path().join("images/0.png"), new.join("images/0.png")),
            (begun.0.path().to_owned(), new.clone()),
            (begun.1.path().join("0.png"), together.join("0.png")),
            (begun.2.path().to_owned(), video.clone()),
            (there.path().join("0.png"), at("there/0.png")),
            (at("other"), at("other")),
        ] {
            assert_eq!(refused(&filled), place);
        }
        let filled = begun.0.path().join("x");
        begun.0.finish().unwrap();
        assert_eq!(refused(&filled), filled, "nothing is remembered of what is finished");
    }

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
    fn a_file_of_another_program_appears_when_it_is_finished_and_not_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/a.mp4");
        let place = Place::begin(&path).unwrap();
        assert_eq!(place.path().file_name(), path.file_name(), "programs go by the extension");
        std::fs::write(place.path(), b"half").unwrap();
        assert!(!path.exists());
        drop(place);
        assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 0);
        let place = Place::begin(&path).unwrap();
        assert!(Place::begin(Path::new("/")).is_err());
        std::fs::write(place.path(), b"whole").unwrap();
        place.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        assert!(Place::begin(&folder.path().join("other")).unwrap().finish().is_err(), "nothing was written");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
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
