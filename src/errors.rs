//! How a command ends when it does not succeed.

use std::process::ExitCode;

/// The command line asks for something that cannot be asked for (exit code 2).
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// The user stopped the command, and what was done so far is kept (exit code 130).
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Stopped(pub String);

/// Prints an error with its chain of causes and gives the exit code that fits.
pub fn report(error: &anyhow::Error) -> ExitCode {
    if error.is::<Stopped>() {
        eprintln!("{error}");
        return ExitCode::from(130);
    }
    eprintln!("error: {error}");
    let mut said = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
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
