//! Where tests find what is not in the repository.
//!
//! - [`shared`]: recordings that may not be passed on. Whoever has them keeps them in a folder `shared` beside the checkout,
//!   or names theirs in the environment variable `ERFGS_SHARED`. Without that folder a test that needs one is not run, which
//!   is noted in `target/not-run` and told by `scripts/test.sh` at its end; in a folder that is there nothing may be missing.
//! - [`fetched`]: recordings of others that `scripts/setup.sh --oracles` fetches, which must be there.
//! - [`python`]: the Python of the oracles, which the same script installs, and which must be there, too.

mod not_run;

use std::{
    env,
    path::{Path, PathBuf},
};

/// The folder of the workspace.
#[must_use]
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().nth(2).unwrap_or(here).to_owned()
}

/// The folder of recordings that may not be passed on, where there is one. A relative `ERFGS_SHARED` is relative to [`root`].
#[must_use]
pub fn folder() -> Option<PathBuf> {
    present(named())
}

/// A file or folder in [`folder`]. `None` without the folder: the test is then noted as not run, and should return.
///
/// # Panics
/// If the folder is there, and what is asked for is not in it.
#[must_use]
#[track_caller]
pub fn shared(file: &str) -> Option<PathBuf> {
    let named = named();
    match find(&named, file) {
        Found::At(path) => Some(path),
        Found::NoFolder => {
            not_run::note(&root().join("target/not-run"), &format!("needs {file} of {}", named.display()));
            None
        }
        Found::Missing(path) => panic!("{} is missing, though {} is there", path.display(), named.display()),
    }
}

/// A recording of those that `scripts/setup.sh --oracles` fetches.
///
/// # Panics
/// If it is not there.
#[must_use]
#[track_caller]
pub fn fetched(file: &str) -> PathBuf {
    let path = root().join("target/recordings").join(file);
    assert!(path.is_file(), "{} is missing: `scripts/setup.sh --oracles` fetches it", path.display());
    path
}

/// The Python of the oracles, or the one that the environment variable `ERFGS_ORACLES` names.
///
/// # Panics
/// If neither is there.
#[must_use]
#[track_caller]
pub fn python() -> PathBuf {
    if let Some(named) = env::var_os("ERFGS_ORACLES") {
        return named.into();
    }
    let path = root().join("target/oracles/bin/python");
    assert!(path.is_file(), "{} is missing: `scripts/setup.sh --oracles` installs it", path.display());
    path
}

/// Where the folder of [`folder`] is, if it is anywhere.
fn named() -> PathBuf {
    let relative = env::var_os("ERFGS_SHARED").map_or_else(|| "../shared".into(), PathBuf::from);
    root().join(relative)
}

fn present(folder: PathBuf) -> Option<PathBuf> {
    folder.is_dir().then_some(folder)
}

#[derive(Debug, PartialEq)]
enum Found {
    At(PathBuf),
    NoFolder,
    Missing(PathBuf),
}

fn find(folder: &Path, file: &str) -> Found {
    let path = folder.join(file);
    if path.exists() {
        Found::At(path)
    } else if folder.is_dir() {
        Found::Missing(path)
    } else {
        Found::NoFolder
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_in_a_folder_that_is_there_is_not_taken_for_a_folder_that_is_not() {
        let folder = root().join("tests");
        assert_eq!(find(&folder, "recordings/Cargo.toml"), Found::At(folder.join("recordings/Cargo.toml")));
        assert_eq!(find(&folder, "recordings/absent"), Found::Missing(folder.join("recordings/absent")));
        assert_eq!(find(&folder.join("absent"), "recordings"), Found::NoFolder);
        assert_eq!((present(folder.join("absent")), present(folder.clone())), (None, Some(folder)));
    }

    #[test]
    fn the_root_is_where_the_workspace_is() {
        let manifest = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
        assert!(manifest.contains("\"tests/recordings\""));
    }
}
