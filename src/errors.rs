//! How a command ends when it does not succeed.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use erfgs_base::{names::printable, order::natural};

/// The command line asks for something that cannot be asked for (exit code 2).
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// Refuses a path at which there is no file that could be a recording.
pub fn recording_at(path: &Path) -> Result<(), Usage> {
    let shown = path.display();
    match (path.exists(), path.is_dir()) {
        (false, _) => Err(Usage(format!("'{shown}' does not exist"))),
        (true, true) => Err(Usage(match bag(path) {
            Some(file) => format!("'{shown}' is a folder of rosbag2: give the file in it, {}", file.display()),
            None => format!("'{shown}' is a folder: give a session (.mcap) or an event file"),
        })),
        (true, false) => Ok(()),
    }
}

/// The recording in a folder as rosbag2 makes it, with `metadata.yaml` beside it.
pub fn bag(folder: &Path) -> Option<PathBuf> {
    if !folder.join("metadata.yaml").is_file() {
        return None;
    }
    let files = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let is_bag = |file: &PathBuf| {
        let name = file.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let name = name.strip_suffix(".zstd").unwrap_or(&name);
        name.ends_with(".mcap") || name.ends_with(".db3")
    };
    files.filter(is_bag).min_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()))
}

/// Refuses to write over what is there, unless that is wanted.
pub fn not_over(path: &Path, force: bool) -> Result<(), Usage> {
    if force || !path.exists() {
        return Ok(());
    }
    Err(Usage(format!("'{}' exists already; --force overwrites it, or give another --out", path.display())))
}

/// The user stopped the command, and what was done so far is kept (exit code 130).
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Stopped(pub String);

/// Prints an error with its chain of causes and gives the exit code that fits.
pub fn report(error: &anyhow::Error) -> ExitCode {
    if error.is::<Stopped>() {
        eprintln!("{}", printable(&error.to_string()));
        return ExitCode::from(130);
    }
    let mut said = printable(&error.to_string());
    eprintln!("error: {said}");
    for cause in error.chain().skip(1).map(|cause| printable(&cause.to_string())) {
        // Library messages often quote their source already.
        if !said.contains(&cause) {
            eprintln!("  because: {cause}");
        }
        said = cause;
    }
    if error.is::<Usage>() {
        eprintln!("  see `erfgs --help`");
        return ExitCode::from(2);
    }
    ExitCode::FAILURE
}
