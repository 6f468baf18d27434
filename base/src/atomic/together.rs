//! Files of one folder that appear together, whether or not the folder is there already.

use std::{
    ffi::OsString,
    io,
    path::{Path, PathBuf},
};

use super::{
    begun::{BegunFolder, PREFIX, Visibility},
    folder_of,
};

/// Files that belong together, such as the pictures of a film: none of them is at its place until all are. Dropped before that, they
/// are removed. Where the folder is there already, what else lies in it stays.
#[derive(Debug)]
pub struct Together {
    building: BegunFolder,
    place: PathBuf,
    /// Whether the folder is ours as a whole.
    is_new: bool,
}

impl Together {
    /// Begins the files of the folder `place`: beside it where it is to be made, and else within it, since it may be a disk of its own.
    ///
    /// # Errors
    /// If nothing can be written there.
    pub fn begin(place: &Path) -> io::Result<Self> {
        let is_new = place.symlink_metadata().is_err();
        let within = if is_new { folder_of(place) } else { place };
        let building = BegunFolder::new(within, PREFIX, Visibility::AsUsual, Some(place))?;
        Ok(Self { building, place: place.to_owned(), is_new })
    }

    /// Where to write until then.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.building.path()
    }

    /// Puts the files in their places. What lies there and `replaces` tells by its name to be of an earlier set goes, so that none of its
    /// files is taken for one of these.
    ///
    /// # Errors
    /// If the place is taken by now or cannot be written.
    pub fn finish(self, replaces: impl Fn(&str) -> bool) -> io::Result<()> {
        if self.is_new {
            return self.building.persist(&self.place);
        }
        // What is listed last by its name tells of all others: it goes first, and comes last.
        for name in names(&self.place)?.iter().rev() {
            if name.to_str().is_some_and(&replaces) {
                std::fs::remove_file(self.place.join(name))?;
            }
        }
        for name in names(self.path())? {
            std::fs::rename(self.path().join(&name), self.place.join(&name))?;
        }
        Ok(())
    }
}

/// Tells the names of numbered files, such as `00017.png` of five digits.
pub fn numbered<'a>(digits: usize, extension: &'a str) -> impl Fn(&str) -> bool + 'a {
    move |name| {
        let stem = name.strip_suffix(extension).and_then(|stem| stem.strip_suffix('.'));
        stem.is_some_and(|stem| stem.len() == digits && stem.bytes().all(|byte| byte.is_ascii_digit()))
    }
}

/// What lies in a folder, by name.
fn names(folder: &Path) -> io::Result<Vec<OsString>> {
    let mut names: Vec<OsString> =
        std::fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.file_name())).collect::<io::Result<_>>()?;
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn there(folder: &Path) -> Vec<String> {
        names(folder).unwrap().into_iter().map(|name| name.into_string().unwrap()).collect()
    }

    fn film(place: &Path, pictures: usize) -> Together {
        let film = Together::begin(place).unwrap();
        for index in 0..pictures {
            std::fs::write(film.path().join(format!("{index}.png")), b"new").unwrap();
        }
        film
    }

    #[test]
    fn a_folder_that_is_new_appears_with_all_its_files() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("deep/film");
        drop(film(&place, 2));
        assert!(there(&folder.path().join("deep")).is_empty());
        let begun = film(&place, 2);
        assert!(!place.exists());
        begun.finish(|_| true).unwrap();
        assert_eq!(there(&place), ["0.png", "1.png"]);
        assert_eq!(there(&folder.path().join("deep")), ["film"]);
    }

    #[test]
    fn in_a_folder_that_is_there_an_earlier_set_goes_and_all_else_stays() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path();
        for name in ["0.png", "1.png", "2.png", "notes.txt"] {
            std::fs::write(place.join(name), b"old").unwrap();
        }
        drop(film(place, 2));
        assert_eq!(there(place), ["0.png", "1.png", "2.png", "notes.txt"]);
        let begun = film(place, 2);
        assert_eq!(std::fs::read(place.join("0.png")).unwrap(), b"old");
        begun.finish(numbered(1, "png")).unwrap();
        assert_eq!(there(place), ["0.png", "1.png", "notes.txt"]);
        assert_eq!(std::fs::read(place.join("0.png")).unwrap(), b"new");
        assert_eq!(std::fs::read(place.join("notes.txt")).unwrap(), b"old");
    }

    #[test]
    fn numbers_have_their_digits_and_nothing_else() {
        let is_ours = numbered(3, "png");
        assert!(is_ours("007.png"));
        for other in ["07.png", "0007.png", "007.exr", "007", "007png", "a07.png", "+07.png", "007.png.csv", ""] {
            assert!(!is_ours(other), "{other}");
        }
    }

    #[test]
    fn what_is_no_folder_is_not_written_over() {
        let file = tempfile::NamedTempFile::new().unwrap();
        assert!(Together::begin(file.path()).is_err());
    }
}
