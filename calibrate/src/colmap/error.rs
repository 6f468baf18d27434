//! What can go wrong when COLMAP runs.

use std::{path::PathBuf, time::Duration};

/// What can go wrong when COLMAP runs.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// Neither a program nor pycolmap.
    #[error(
        "COLMAP was not found ({tried}); install it (Debian, Ubuntu: apt install colmap; any system: pip install \
         pycolmap), or name it with --colmap PATH or --colmap pycolmap:PYTHON"
    )]
    Missing {
        /// What was tried.
        tried: String,
    },
    /// COLMAP ended with an error.
    #[error("COLMAP's {step} failed ({status}) running '{command}'; its last words were:\n{log}")]
    Failed {
        /// The subcommand, such as `feature_extractor`.
        step: &'static str,
        /// How the program ended.
        status: String,
        /// The command line.
        command: String,
        /// The end of what it printed.
        log: String,
    },
    /// COLMAP did nothing, each time that it was tried.
    #[error(
        "COLMAP's {step} was begun {attempts} times, did nothing for {:.0} s each time and was ended, running '{command}'; try another \
         version of COLMAP (--colmap PATH, --colmap pycolmap:PYTHON), or fewer threads (--jobs); its last words were:\n{log}",
        patience.as_secs_f64()
    )]
    Hung {
        /// The subcommand, such as `feature_extractor`.
        step: &'static str,
        /// How often it was begun.
        attempts: u32,
        /// For how long it did nothing.
        patience: Duration,
        /// The command line.
        command: String,
        /// The end of what it printed the last time.
        log: String,
    },
    /// The database is not as expected.
    #[error("while {doing} in COLMAP's database {}: {why}", path.display())]
    Database {
        /// What was being done.
        doing: &'static str,
        /// The database.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
}
