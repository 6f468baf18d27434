//! `erfgs dataset undistort`: images and events as ideal pinholes see them.

use std::path::PathBuf;

use erfgs_dataset::{Dataset, undistort::undistort};

use crate::{info, terminal::Terminal};

/// Make a dataset of ideal pinhole cameras.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The trainer's cameras are pinholes: a dataset with lens distortion is undistorted first. Images keep their size and \
focal length; event positions are mapped with the same model.

Example:
  erfgs dataset undistort ds --out ds-pinhole")]
pub struct Arguments {
    /// The dataset.
    dataset: PathBuf,
    /// The folder of the new dataset.
    #[arg(long, value_name = "DATASET")]
    out: PathBuf,
}

/// Undistorts and says what came of it.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let dataset = Dataset::load(&arguments.dataset)?;
    let progress = terminal.progress("undistorting");
    let pinhole = undistort(&dataset, &arguments.out, &mut |step| progress.update(step.done, step.total, step.what))?;
    drop(progress);
    info::dataset(&pinhole, terminal)
}
