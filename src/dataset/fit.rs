//! Whether the cameras of a dataset stand where its calibration has them.

use anyhow::Context;
use erfgs_calibrate::{
    colmap::{ColmapProgram, RunError},
    sfm::{FitOptions, SfmError, fit, read_still_views},
};
use erfgs_dataset::Dataset;
use erfgs_points::{Cloud, EventFit, event_fit};

use crate::terminal::Terminal;

/// Fewer cameras with frames cannot be held against each other.
const FEWEST: usize = 4;

/// Holds the poses of a dataset against what its cameras show of what stands still.
///
/// # Errors
/// If cameras do not stand where they should.
pub fn check(dataset: &Dataset, colmap: &ColmapProgram, terminal: &Terminal) -> anyhow::Result<()> {
    let cameras: Vec<_> = dataset.manifest.cameras.iter().filter(|camera| !camera.frames.is_empty()).collect();
    if cameras.len() < FEWEST {
        return Ok(());
    }
    let views = read_still_views(dataset)?;
    let poses: Vec<_> = cameras.iter().map(|camera| camera.world_to_camera).collect();
    let options = FitOptions { colmap: colmap.clone(), ..FitOptions::default() };
    let work = erfgs_base::scratch::Scratch::new().context("cannot make a folder for intermediate files")?;
    let progress = terminal.progress("checking poses");
    let found = fit(&views, &poses, &options, work.path(), &|stage, done, total| {
        progress.update(done as u64, total as u64, &stage.to_string());
    });
    drop(progress);
    let found = match found {
        Err(SfmError::Colmap(error @ RunError::Missing { .. })) => {
            terminal.note(format!("camera poses could not be checked against the pictures: {error}"));
            return Ok(());
        }
        found => found?,
    };
    if found.wrong.is_empty() && 2 * found.judged() < cameras.len() {
        terminal.note(format!(
            "camera poses were checked against the pictures for {} of {} cameras only: the others share too few points",
            found.judged(),
            cameras.len()
        ));
    }
    let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    let Some(complaint) = found.complaint(&names) else { return Ok(()) };
    let remedy = if found.has_majority() {
        let without: Vec<String> = found.wrong.iter().map(|&view| format!("--without {}", names[view])).collect();
        format!(", or leave out what moved at the import ({})", without.join(" "))
    } else {
        String::new()
    };
    anyhow::bail!(
        "{complaint}. Calibrate again{remedy}; `erfgs dataset points --trust-poses` takes the poses as they are"
    );
}

/// Holds event cameras against the points of what moves.
///
/// # Errors
/// If a camera hangs upside down.
pub fn check_events(dataset: &Dataset, cloud: &Cloud) -> anyhow::Result<()> {
    let found = event_fit(dataset, &cloud.points)?;
    let wrong: Vec<_> = found.iter().filter(|found| found.is_upside_down()).collect();
    if wrong.is_empty() {
        return Ok(());
    }
    let list: Vec<String> = wrong
        .iter()
        .map(|EventFit { camera, upright, upside_down }| {
            format!(
                "{camera} hangs upside down: its events agree with what moves if it is turned by half a turn (correlation \
                 {upside_down:.2}) and not by its pose ({upright:.2})"
            )
        })
        .collect();
    let without: Vec<String> = wrong.iter().map(|found| format!("--without {}", found.camera)).collect();
    anyhow::bail!(
        "{}. Calibrate again, or leave it out at the import ({}); `erfgs dataset points --trust-poses` takes the poses as they are",
        list.join("; "),
        without.join(" ")
    );
}
