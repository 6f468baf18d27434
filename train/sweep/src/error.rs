//! What can go wrong with a sweep.

use std::path::PathBuf;

use erfgs_base::FileError;
use erfgs_run::RunError;

/// What can go wrong with a sweep.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A run could not be read.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The plan does not parse.
    #[error("'{}' is not a plan of a sweep: {message}; docs/guide/sweeps.md lists what a plan may hold", path.display())]
    Plan {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// The manifest does not parse.
    #[error("'{}' is not the manifest of a sweep: {message}; give the plan again, which writes it anew", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A script has no place for a text.
    #[error(
        "{what} {text:?} cannot stand in a job's script: it has a line break or another control character; give it another name"
    )]
    Line {
        /// What it is.
        what: &'static str,
        /// The text.
        text: String,
    },
    /// There is no sweep in a folder.
    #[error("'{}' holds no sweep (no sweep.json); give the plan, which writes one", folder.display())]
    NoSweep {
        /// The folder.
        folder: PathBuf,
    },
    /// The manifest knows no such job.
    #[error("the sweep in '{}' has no job '{name}'; its plan was changed since it was submitted", folder.display())]
    NoJob {
        /// The folder.
        folder: PathBuf,
        /// The job.
        name: String,
    },
    /// A dataset of the plan is none.
    #[error("dataset '{}' of the plan has no dataset.json; give the folder of a dataset", folder.display())]
    NoDataset {
        /// The folder.
        folder: PathBuf,
    },
    /// All runs on a dataset would make its points at once.
    #[error(
        "dataset '{}' has no initial points, which all of its runs would make at once; run `erfgs dataset points {}` first",
        folder.display(),
        folder.display()
    )]
    NoPoints {
        /// The folder.
        folder: PathBuf,
    },
    /// A command could not be started.
    #[error("could not start '{command}': {source}")]
    Start {
        /// The command.
        command: String,
        /// Why.
        source: std::io::Error,
    },
    /// A command of Slurm failed.
    #[error("`{command}` failed: {message}; run it by hand to see more, or use --local")]
    Slurm {
        /// The command.
        command: String,
        /// What it said.
        message: String,
    },
    /// What was submitted cannot be read.
    #[error("{path}, which says what was submitted, cannot be read ({what}); look with `squeue --me` whether anything of it runs, and remove the file if nothing does", path = path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// What is noted of a job cannot be read.
    #[error(
        "{path}, which says how often the run was started and why it failed, is damaged ({what}); remove it: the same command then goes on \
         with the run where its checkpoint is",
        path = path.display()
    )]
    JobRecord {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A newer program wrote the manifest.
    #[error(
        "'{}' is of version {found}, and this erfgs reads versions up to {known}; go on with the erfgs that wrote it, or give the plan \
         another `out`",
        path.display()
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u32,
        /// The newest version that is understood.
        known: u32,
    },
    /// Slurm answered what is not understood.
    #[error("`{command}` answered '{answer}', which is not the id of a job")]
    Answer {
        /// The command.
        command: String,
        /// What it said.
        answer: String,
    },
}
