//! How a command ends when it does not succeed.

use std::{borrow::Cow, path::Path, process::ExitCode};

use erfgs_base::{atomic::numbered, names::printable};
use erfgs_session::container::recording_file;

/// The command line asks for something that cannot be asked for (exit code 2).
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// The file with a recording at `path`; a folder of rosbag2 has one.
pub fn recording_at(path: &Path) -> anyhow::Result<Cow<'_, Path>> {
    let shown = path.display();
    if !path.exists() {
        return Err(Usage(format!("'{shown}' does not exist")).into());
    }
    let file = recording_file(path)?;
    if file.is_dir() {
        return Err(Usage(format!("'{shown}' is a folder: give a session (.mcap) or an event file")).into());
    }
    Ok(file)
}

/// Refuses to write over what is there, unless that is wanted.
pub fn not_over(path: &Path, force: bool) -> Result<(), Usage> {
    if force || !path.exists() {
        return Ok(());
    }
    Err(Usage(format!("'{}' exists already; --force overwrites it, or give another --out", path.display())))
}

/// Refuses to write numbered pictures into a folder that has some, unless that is wanted.
pub fn not_over_pictures(folder: &Path, digits: usize, extension: &str, force: bool) -> Result<(), Usage> {
    let is_picture = numbered(digits, extension);
    let there = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    match there.filter(|name| name.to_str().is_some_and(&is_picture)).min() {
        Some(first) => not_over(&folder.join(first), force),
        None => Ok(()),
    }
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
    let mut message = printable(&error.to_string());
    eprintln!("error: {message}");
    for cause in error.chain().skip(1).map(|cause| printable(&cause.to_string())) {
        // Library messages often quote their source already.
        if !message.contains(&cause) {
            eprintln!("  because: {cause}");
        }
        message = cause;
    }
    if error.is::<Usage>() {
        eprintln!("  see `erfgs --help`");
        return ExitCode::from(2);
    }
    ExitCode::FAILURE
}
