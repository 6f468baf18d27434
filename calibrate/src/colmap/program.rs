//! Finding and running COLMAP: the `colmap` program of any version from 3.8 on, or pycolmap 4.x.
//!
//! Flags were renamed between 3.8 and 4.x (`SiftExtraction.use_gpu`, `FeatureExtraction.use_gpu`), and each version
//! refuses the other's names. The program's own `--help` says which it knows.

use std::{
    collections::HashSet,
    env,
    ffi::OsString,
    path::{Path, PathBuf},
    process::Command,
};

use serde::Serialize;

use super::process::{Outcome, run};
use super::{ColmapProgram, RunError};

const SCRIPT: &str = include_str!("pycolmap.py");

/// A COLMAP that answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Colmap {
    /// The program.
    Binary {
        /// Where it is.
        path: PathBuf,
        /// What it calls itself, such as `COLMAP 3.8`.
        version: String,
    },
    /// Its Python package.
    Pycolmap {
        /// The Python that has it.
        python: PathBuf,
        /// What the package calls itself.
        version: String,
    },
}

/// Is told items done and in all.
pub type Count<'a> = &'a (dyn Fn(usize, usize) + Sync);

impl Colmap {
    /// Finds the COLMAP asked for and asks its version.
    ///
    /// # Errors
    /// [`RunError::Missing`], saying what was tried.
    pub fn find(program: &ColmapProgram) -> Result<Self, RunError> {
        let missing = |tried: Vec<String>| RunError::Missing { tried: tried.join("; ") };
        match program {
            ColmapProgram::Binary(path) => Self::binary(path).map_err(|why| missing(vec![why])),
            ColmapProgram::Pycolmap(python) => {
                let python = python.clone().unwrap_or_else(default_python);
                Self::pycolmap(&python).map_err(|why| missing(vec![why]))
            }
            ColmapProgram::Auto => Self::binary(Path::new("colmap"))
                .or_else(|first| Self::pycolmap(&default_python()).map_err(|second| missing(vec![first, second]))),
        }
    }

    fn binary(path: &Path) -> Result<Self, String> {
        let output = Command::new(path).arg("help").output();
        let output = output.map_err(|error| format!("running '{} help': {error}", path.display()))?;
        let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).join("\n");
        let line = text.lines().find(|line| line.starts_with("COLMAP "));
        let line = line.ok_or_else(|| format!("'{} help' does not answer as COLMAP does", path.display()))?;
        let version = line.split([',', '(', '-']).next().unwrap_or(line).trim().to_owned();
        Ok(Self::Binary { path: path.to_owned(), version })
    }

    fn pycolmap(python: &Path) -> Result<Self, String> {
        let output = Command::new(python).args(["-c", SCRIPT, "version"]).output();
        let output = output.map_err(|error| format!("running '{}': {error}", python.display()))?;
        let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        let major = version.split('.').next().and_then(|major| major.parse::<u32>().ok());
        match major {
            Some(major) if output.status.success() && major >= 4 => {
                Ok(Self::Pycolmap { python: python.to_owned(), version })
            }
            Some(_) if output.status.success() => {
                Err(format!("'{}' has pycolmap {version}, and 4 or later is needed", python.display()))
            }
            _ => Err(format!("'{}' has no pycolmap", python.display())),
        }
    }

    /// Name and version, such as `COLMAP 3.8` or `pycolmap 4.2.1`.
    #[must_use]
    pub fn version(&self) -> String {
        match self {
            Self::Binary { version, .. } => version.clone(),
            Self::Pycolmap { version, .. } => format!("pycolmap {version}"),
        }
    }
}

pub(super) fn text(value: impl ToString) -> OsString {
    value.to_string().into()
}

/// `$ERFGS_PYTHON`, or `python3` on the PATH.
fn default_python() -> PathBuf {
    env::var_os("ERFGS_PYTHON").map_or_else(|| "python3".into(), PathBuf::from)
}

/// The flags that a subcommand knows.
pub(super) struct Flags {
    step: &'static str,
    known: HashSet<String>,
}

/// The names a flag has had, newest first; its value; whether the step cannot do without it.
type Wanted<'a> = (&'a [&'a str], OsString, bool);

impl Flags {
    pub(super) fn of(path: &Path, step: &'static str) -> Result<Self, RunError> {
        let output = Command::new(path).args([step, "--help"]).output();
        let output = output.map_err(|error| RunError::Missing {
            tried: format!("running '{} {step} --help': {error}", path.display()),
        })?;
        let known = [output.stdout, output.stderr]
            .iter()
            .flat_map(|bytes| String::from_utf8_lossy(bytes).split_whitespace().map(str::to_owned).collect::<Vec<_>>())
            .filter_map(|word| word.strip_prefix("--").map(str::to_owned))
            .collect();
        Ok(Self { step, known })
    }

    /// The command line with the first known name of each flag.
    pub(super) fn choose(&self, wanted: &[Wanted<'_>]) -> Result<Vec<OsString>, RunError> {
        let mut arguments = Vec::with_capacity(2 * wanted.len());
        for (names, value, needed) in wanted {
            match names.iter().find(|name| self.known.contains(**name)) {
                Some(name) => arguments.extend([format!("--{name}").into(), value.clone()]),
                None if *needed => {
                    return Err(RunError::Missing {
                        tried: format!("this version's {} knows none of {names:?}; 3.8 to 4.x do", self.step),
                    });
                }
                None => {}
            }
        }
        Ok(arguments)
    }
}

pub(super) fn binary_step(
    step: &'static str,
    path: &Path,
    arguments: Vec<OsString>,
    progress: Count<'_>,
) -> Result<(), RunError> {
    let mut command = Command::new(path);
    command.arg(step).args(arguments);
    finish(step, command, progress)
}

pub(super) fn python_step(
    step: &'static str,
    python: &Path,
    name: &str,
    job: &impl Serialize,
    progress: Count<'_>,
) -> Result<(), RunError> {
    let job = serde_json::to_string(job).map_err(|error| RunError::Failed {
        step,
        status: "its job cannot be written down".into(),
        command: python.display().to_string(),
        log: error.to_string(),
    })?;
    let mut command = Command::new(python);
    command.args(["-c", SCRIPT, name, &job]);
    finish(step, command, progress)
}

fn finish(step: &'static str, command: Command, progress: Count<'_>) -> Result<(), RunError> {
    let described = describe(&command);
    tracing::debug!("{described}");
    match run(command, progress) {
        Ok(Outcome { status, .. }) if status.success() => Ok(()),
        Ok(Outcome { status, tail }) => {
            Err(RunError::Failed { step, status: status.to_string(), command: described, log: tail })
        }
        Err(error) => Err(RunError::Failed {
            step,
            status: "it could not be run".into(),
            command: described,
            log: error.to_string(),
        }),
    }
}

/// The command line, without the embedded script.
fn describe(command: &Command) -> String {
    let words = command.get_args().map(|word| if word == SCRIPT { "...".into() } else { word.to_string_lossy() });
    let words: Vec<_> = std::iter::once(command.get_program().to_string_lossy()).chain(words).collect();
    words.join(" ")
}

#[cfg(test)]
#[path = "program_tests.rs"]
mod tests;
