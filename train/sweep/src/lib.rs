//! Many trainings by one plan: every dataset, or every window of a long take, with every combination of settings and every
//! seed. They run on Slurm where there is one, and on this machine where there is none, one command either way, which may be
//! given again at any time: what is finished stays, what was stopped goes on.
//!
//! ```text
//! plan.toml ──► Plan ──► Manifest (sweep.json): a Job for each run
//!                           │
//!                           ├──► local: so many at a time, each by work::work
//!                           └──► slurm: job arrays, whose tasks are `erfgs sweep OUT --job NAME`, that is, work::work
//! ```
//!
//! A job is steps that are commands of the program itself: a window is imported and gets its points, the run is trained, and
//! measured. Each can be killed anywhere and is started again by the same words. `docs/guide/sweeps.md` is the user's view.

mod damage;
mod error;
mod jobs;
mod local;
mod manifest;
mod plan;
mod shell;
pub mod slurm;
mod status;
mod takes;
mod work;

pub use error::SweepError;
pub use local::run as run_here;
pub use manifest::{Job, Manifest, Preparation, Window};
pub use plan::{Plan, SlurmOptions, Take};
pub use shell::line as shell_line;
pub use status::{JobState, JobStatus, OverSeeds, Overview};
pub use takes::{TrainedTake, TrainedWindow};
pub use work::{Ended, commands, work};
