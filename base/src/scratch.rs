//! Private folders for intermediate files.

use std::{io, path::Path};

use crate::atomic::begun::{BegunFolder, Visibility};

/// What they are called, in the system's folder for temporary files.
pub(crate) const PREFIX: &str = "erfgs-scratch-";

/// A folder for intermediate files, which only this user can look into. It is removed when it is dropped, by [`ending::clear`],
/// and, where the process was killed, by the next one that asks for such a folder.
///
/// [`ending::clear`]: crate::ending::clear
#[derive(Debug)]
pub struct Scratch(BegunFolder);

impl Scratch {
    /// Makes a folder below the system's folder for temporary files.
    ///
    /// # Errors
    /// If nothing can be written there.
    pub fn new() -> io::Result<Self> {
        let parent = std::env::temp_dir();
        let named = |error: io::Error| {
            io::Error::new(error.kind(), format!("{}: {error}; set TMPDIR to a folder with room", parent.display()))
        };
        BegunFolder::new(&parent, PREFIX, Visibility::Privately, None).map(Self).map_err(named)
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_else_sees_it_and_nothing_is_left() {
        let scratch = Scratch::new().unwrap();
        let path = scratch.path().to_owned();
        std::fs::create_dir(path.join("deep")).unwrap();
        std::fs::write(path.join("deep/x"), b"x").unwrap();
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o700);
        }
        // Another one is not taken for what was left.
        let other = Scratch::new().unwrap();
        assert!(path.join("deep/x").exists() && other.path() != path);
        drop(scratch);
        assert!(!path.exists());
    }
}
