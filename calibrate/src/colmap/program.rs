//! Finding and running COLMAP: the `colmap` program of any version from 3.8 on, or pycolmap 4.x.
//!
//! Flags were renamed between 3.8 and 4.x (`SiftExtraction.use_gpu`, `FeatureExtraction.use_gpu`), and each version
//! refuses the other's names. The program's own `--help` says which it knows.

use std::{
    collections::HashSet,
    env,
    ffi::OsString,
    io,
    path::{Path, PathBuf},
    process::{Command, ExitStatus},
    time::Duration,
};

use erfgs_base::children::{self, Ended};
use serde::Serialize;

use super::{
    ColmapProgram, RunError,
    output::{Tail, count, registered},
};

const SCRIPT: &str = include_str!("pycolmap.py");

/// For so long COLMAP may neither run nor use the processor nor say anything before it is ended. COLMAP 3.8 sometimes loses a wake-up:
/// all of its threads wait for each other, for ever.
const PATIENCE: Duration = Duration::from_secs(60);
/// How often a step is begun before there is no hope.
const ATTEMPTS: u32 = 3;

/// A COLMAP that answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Colmap {
    pub(super) program: Program,
    version: String,
    patience: Duration,
}

/// What is run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Program {
    /// The program, here.
    Binary(PathBuf),
    /// Its Python package, by this Python.
    Pycolmap(PathBuf),
}

/// Is told items done and in all.
pub type Count<'a> = &'a (dyn Fn(usize, usize) + Sync);

impl Colmap {
    /// Finds the COLMAP asked for and asks its version.
    ///
    /// # Errors
    /// [`RunError::Missing`], saying what was tried.
    pub fn find(program: &ColmapProgram) -> Result<Self, RunError> {
        Self::find_within(program, PATIENCE)
    }

    /// As [`Colmap::find`], of a COLMAP that is ended where it does nothing for `patience`.
    ///
    /// # Errors
    /// [`RunError::Missing`], saying what was tried.
    pub fn find_within(program: &ColmapProgram, patience: Duration) -> Result<Self, RunError> {
        let missing = |tried: Vec<String>| RunError::Missing { tried: tried.join("; ") };
        let binary = |path: &Path| Self::binary(path, patience);
        let pycolmap = |python: &Path| Self::pycolmap(python, patience);
        match program {
            ColmapProgram::Binary(path) => binary(path).map_err(|why| missing(vec![why])),
            ColmapProgram::Pycolmap(python) => {
                let python = python.clone().unwrap_or_else(default_python);
                pycolmap(&python).map_err(|why| missing(vec![why]))
            }
            ColmapProgram::Auto => binary(Path::new("colmap"))
                .or_else(|first| pycolmap(&default_python()).map_err(|second| missing(vec![first, second]))),
        }
    }

    fn binary(path: &Path, patience: Duration) -> Result<Self, String> {
        let mut command = Command::new(path);
        command.arg("help");
        let (_, text) = answer(command, patience).map_err(|why| format!("running '{} help': {why}", path.display()))?;
        let line = text.lines().find(|line| line.starts_with("COLMAP "));
        let line = line.ok_or_else(|| format!("'{} help' does not answer as COLMAP does", path.display()))?;
        let version = line.split([',', '(', '-']).next().unwrap_or(line).trim().to_owned();
        Ok(Self { program: Program::Binary(path.to_owned()), version, patience })
    }

    fn pycolmap(python: &Path, patience: Duration) -> Result<Self, String> {
        let mut command = Command::new(python);
        command.args(["-c", SCRIPT, "version"]);
        let (status, text) =
            answer(command, patience).map_err(|why| format!("running '{}': {why}", python.display()))?;
        let version = text.lines().last().unwrap_or_default().trim().to_owned();
        let major = version.split('.').next().and_then(|major| major.parse::<u32>().ok());
        match major {
            Some(major) if status.success() && major >= 4 => {
                let version = format!("pycolmap {version}");
                Ok(Self { program: Program::Pycolmap(python.to_owned()), version, patience })
            }
            Some(_) if status.success() => {
                Err(format!("'{}' has pycolmap {version}, and 4 or later is needed", python.display()))
            }
            _ => Err(format!("'{}' has no pycolmap", python.display())),
        }
    }

    /// Name and version, such as `COLMAP 3.8` or `pycolmap 4.2.1`.
    #[must_use]
    pub fn version(&self) -> String {
        self.version.clone()
    }

    /// Runs a step of the program, with the arguments that its version knows.
    pub(super) fn binary_step(
        &self,
        step: &'static str,
        path: &Path,
        wanted: &[Wanted<'_>],
        again: &dyn Fn() -> io::Result<()>,
        progress: Count<'_>,
    ) -> Result<(), RunError> {
        let arguments = Flags::of(path, step, self.patience)?.choose(wanted)?;
        let command = || {
            let mut command = Command::new(path);
            command.arg(step).args(&arguments);
            command
        };
        self.finish(step, &command, again, progress)
    }

    /// Runs a step of the Python package.
    pub(super) fn python_step(
        &self,
        step: &'static str,
        (python, name): (&Path, &str),
        job: &impl Serialize,
        again: &dyn Fn() -> io::Result<()>,
        progress: Count<'_>,
    ) -> Result<(), RunError> {
        let job = serde_json::to_string(job).map_err(|error| RunError::Failed {
            step,
            status: "its job file cannot be written".into(),
            command: python.display().to_string(),
            log: error.to_string(),
        })?;
        let command = || {
            let mut command = Command::new(python);
            command.args(["-c", SCRIPT, name, &job]);
            command
        };
        self.finish(step, &command, again, progress)
    }

    /// Runs a step to its end; from the beginning where it hangs, after `again` has removed what it made.
    fn finish(
        &self,
        step: &'static str,
        command: &dyn Fn() -> Command,
        again: &dyn Fn() -> io::Result<()>,
        progress: Count<'_>,
    ) -> Result<(), RunError> {
        let described = describe(&command());
        tracing::debug!("{described}");
        let failed = |status: String, log: String| RunError::Failed { step, status, command: described.clone(), log };
        let mut log = Tail::default();
        for attempt in 1..=ATTEMPTS {
            log = Tail::default();
            let on_line = |line: &str| {
                // A mapper does not say how many there are to be.
                if let Some((done, total)) = count(line).or_else(|| Some((registered(line)?, 0))) {
                    progress(done, total);
                }
                log.push(line);
            };
            match children::run(command(), self.patience, on_line) {
                Ok(Ended::Itself(status)) if status.success() => return Ok(()),
                Ok(Ended::Itself(status)) => return Err(failed(status.to_string(), log.text())),
                Ok(Ended::Hung) if attempt < ATTEMPTS => {
                    let seconds = self.patience.as_secs_f64();
                    tracing::warn!(
                        "COLMAP's {step} did nothing for {seconds:.0} s and was ended; it is run again, {} of {ATTEMPTS}",
                        attempt + 1
                    );
                    again().map_err(|error| failed("its leftovers cannot be removed".into(), error.to_string()))?;
                }
                Ok(Ended::Hung) => {}
                Err(error) => return Err(failed("it could not be run".into(), error.to_string())),
            }
        }
        Err(RunError::Hung {
            step,
            attempts: ATTEMPTS,
            patience: self.patience,
            command: described.clone(),
            log: log.text(),
        })
    }
}

/// How a program ended that was asked something, and all that it said.
fn answer(command: Command, patience: Duration) -> Result<(ExitStatus, String), String> {
    let mut text = String::new();
    let on_line = |line: &str| {
        // No version says more; what is no COLMAP may say anything.
        if text.len() < 1 << 20 {
            text.push_str(line);
            text.push('\n');
        }
    };
    match children::run(command, patience, on_line) {
        Ok(Ended::Itself(status)) => Ok((status, text)),
        Ok(Ended::Hung) => Err(format!("no answer in {:.0} s", patience.as_secs_f64())),
        Err(error) => Err(error.to_string()),
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
struct Flags {
    step: &'static str,
    known: HashSet<String>,
}

/// The names a flag has had, newest first; its value; whether the step cannot do without it.
pub(super) type Wanted<'a> = (&'a [&'a str], OsString, bool);

impl Flags {
    fn of(path: &Path, step: &'static str, patience: Duration) -> Result<Self, RunError> {
        let mut command = Command::new(path);
        command.args([step, "--help"]);
        let missing =
            |why: String| RunError::Missing { tried: format!("running '{} {step} --help': {why}", path.display()) };
        let (_, text) = answer(command, patience).map_err(missing)?;
        let known = text.split_whitespace().filter_map(|word| word.strip_prefix("--").map(str::to_owned)).collect();
        Ok(Self { step, known })
    }

    /// The command line with the first known name of each flag.
    fn choose(&self, wanted: &[Wanted<'_>]) -> Result<Vec<OsString>, RunError> {
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

/// The command line, without the embedded script.
fn describe(command: &Command) -> String {
    let words = command.get_args().map(|word| if word == SCRIPT { "...".into() } else { word.to_string_lossy() });
    let words: Vec<_> = std::iter::once(command.get_program().to_string_lossy()).chain(words).collect();
    words.join(" ")
}

#[cfg(test)]
#[path = "program_tests.rs"]
mod tests;
