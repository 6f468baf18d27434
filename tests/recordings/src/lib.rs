//! Where tests find what is not in the repository.
//!
//! - [`shared`]: recordings that may not be passed on. Whoever has them keeps them in a folder `shared` beside the checkout,
//!   or names theirs in the environment variable `ERFGS_SHARED`. Without that folder a test that needs one fails. Whoever has none
//!   says so with `ERFGS_SHARED=none`: such a test then is not run, which is noted in `target/not-run` and listed by
//!   `scripts/test.sh` at its end.
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

/// What `ERFGS_SHARED` is where somebody has no such recordings.
const NONE: &str = "none";

/// The folder of recordings that may not be passed on, where there is one. A relative `ERFGS_SHARED` is relative to [`root`].
#[must_use]
pub fn folder() -> Option<PathBuf> {
    named().filter(|folder| folder.is_dir())
}

/// A file or folder in [`folder`]. `None` where `ERFGS_SHARED=none`: the test is then noted as not run, and should return.
///
/// # Panics
/// If it is not there.
#[must_use]
#[track_caller]
pub fn shared(file: &str) -> Option<PathBuf> {
    let Some(named) = named() else {
        not_run::note(&root().join("target/not-run"), &format!("needs the recording {file}"));
        return None;
    };
    Some(find(&named, file).unwrap_or_else(|why| panic!("{why}")))
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

/// Where the folder of [`folder`] has to be; none where nobody has it.
fn named() -> Option<PathBuf> {
    let named = env::var_os("ERFGS_SHARED").unwrap_or_else(|| "../shared".into());
    (named != NONE).then(|| root().join(named))
}

fn find(folder: &Path, file: &str) -> Result<PathBuf, String> {
    let path = folder.join(file);
    if path.exists() {
        Ok(path)
    } else if folder.is_dir() {
        Err(format!("{} is missing, though {} is there", path.display(), folder.display()))
    } else {
        Err(format!(
            "this test needs {file} of {}, which is not there: name the folder of these recordings in ERFGS_SHARED, or leave out \
             the tests that need them by ERFGS_SHARED={NONE}",
            folder.display()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_recording_and_a_missing_folder_fail_with_what_to_do() {
        let folder = root().join("tests");
        assert_eq!(find(&folder, "recordings/Cargo.toml"), Ok(folder.join("recordings/Cargo.toml")));
        let why =
            [find(&folder, "recordings/absent"), find(&folder.join("absent"), "recordings")].map(Result::unwrap_err);
        assert!(why[0].contains("is missing, though"), "{why:?}");
        assert!(why[1].contains("ERFGS_SHARED=none"), "{why:?}");
    }

    #[test]
    fn the_root_is_where_the_workspace_is() {
        let manifest = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
        assert!(manifest.contains("\"tests/recordings\""));
    }
}
