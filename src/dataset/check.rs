//! `erfgs dataset check`: every file read, every number of the manifest checked, and the poses held against the pictures.

use std::path::PathBuf;

use erfgs_calibrate::colmap::ColmapProgram;
use erfgs_dataset::Dataset;

use super::fit;
use crate::{info, terminal::Terminal};

/// Read every file of a dataset and check it against the manifest, and the poses against the pictures.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs dataset check ds
  erfgs dataset check ds --json | jq .cameras")]
pub struct Arguments {
    /// The dataset.
    dataset: PathBuf,
}

/// Checks and says what the dataset holds.
///
/// # Errors
/// If a file is not as the manifest says, or a camera does not stand where its calibration has it.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let dataset = Dataset::load(&arguments.dataset)?;
    dataset.verify()?;
    let progress = terminal.progress("reading");
    let total = dataset.manifest.cameras.len() as u64;
    for (done, camera) in dataset.manifest.cameras.iter().enumerate() {
        progress.update(done as u64, total, &format!("camera {}", camera.name));
        for frame in &camera.frames {
            dataset.read_image(camera, frame)?;
            dataset.read_mask(camera, frame)?;
        }
        dataset.read_events(camera)?;
    }
    dataset.read_points()?;
    drop(progress);
    terminal.note("every file is as the manifest says");
    info::dataset(&dataset, terminal)?;
    fit::check(&dataset, &ColmapProgram::default(), terminal)
}
