//! The list of tests that were not run.

use std::{
    collections::BTreeSet,
    env, fs,
    io::Write,
    panic::Location,
    path::Path,
    sync::{Mutex, PoisonError},
    thread,
};

/// The lines that this program has written.
static WRITTEN: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// Notes in `folder` that the test of this thread was not run, and why: a line of a file for each package, once.
///
/// # Panics
/// If the line cannot be written: the test would pass for one that was run.
#[track_caller]
pub fn note(folder: &Path, why: &str) {
    let package = env::var("CARGO_PKG_NAME").unwrap_or_else(|_| "tests".into());
    let line = line(&package, thread::current().name(), Location::caller(), why);
    eprintln!("not run: {line}");
    let mut written = WRITTEN.lock().unwrap_or_else(PoisonError::into_inner);
    if !written.insert(line.clone()) {
        return;
    }
    let write = || {
        fs::create_dir_all(folder)?;
        let mut file = fs::OpenOptions::new().create(true).append(true).open(folder.join(&package))?;
        // At once, as other programs may write to the same file.
        file.write_all(format!("{line}\n").as_bytes())
    };
    write().unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
}

/// Where tests take turns they have no threads of their own, and the place in the source stands for the name.
fn line(package: &str, thread: Option<&str>, place: &Location<'_>, why: &str) -> String {
    match thread {
        Some(test) if test != "main" => format!("{package}::{test}: {why}"),
        _ => format!("{package}, {}:{}: {why}", place.file(), place.line()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_test_that_is_not_run_is_noted_once_with_its_name_and_the_reason() {
        let folder = env::temp_dir().join(format!("erfgs-not-run-{}", std::process::id()));
        // Twice from the same place.
        for why in ["needs a of /b", "needs c of /b"].into_iter().flat_map(|why| [why; 2]) {
            note(&folder, why);
        }
        let files: Vec<_> = fs::read_dir(&folder).unwrap().map(|file| file.unwrap().path()).collect();
        let [file] = &files[..] else { panic!("{files:?}") };
        let noted = fs::read_to_string(file).unwrap();
        let lines: Vec<_> = noted.lines().map(|line| line.split_once(": ").unwrap()).collect();
        assert_eq!(lines.iter().map(|&(_, why)| why).collect::<Vec<_>>(), ["needs a of /b", "needs c of /b"]);
        assert!(
            lines
                .iter()
                .all(|&(test, _)| test == lines[0].0 && test.contains(file.file_name().unwrap().to_str().unwrap()))
        );
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_test_without_a_thread_of_its_own_is_named_by_its_place() {
        let place = Location::caller();
        let expected = format!("a, {}:{}: why", file!(), place.line());
        assert_eq!(
            (line("a", Some("main"), place, "why"), line("a", None, place, "why")),
            (expected.clone(), expected)
        );
    }
}
