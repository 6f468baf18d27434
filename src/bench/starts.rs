//! What the trainings of a measurement start from: points and bodies of the datasets that it makes.

use std::sync::atomic::{AtomicBool, Ordering};

use erfgs_dataset::Dataset;
use erfgs_points::{BodyOptions, CloudError, CloudOptions, Method};

use crate::{
    dataset::{bodies, points},
    errors::Stopped,
    terminal::Terminal,
};

/// Refuses to make more datasets once the user wants to stop.
pub fn go_on(stop: &AtomicBool) -> anyhow::Result<()> {
    if stop.load(Ordering::Relaxed) {
        return Err(Stopped("stopped while making datasets; the same command continues".into()).into());
    }
    Ok(())
}

/// Gives a dataset what it lacks: points, for which its cameras are trusted however wrong they are, and bodies where they are wanted and
/// something shows them. Features need larger pictures than `small` ones.
pub fn give(
    dataset: &mut Dataset,
    small: bool,
    with_bodies: bool,
    stop: &AtomicBool,
    terminal: &Terminal,
) -> anyhow::Result<()> {
    go_on(stop)?;
    if dataset.manifest.points.is_none() {
        let mut options = CloudOptions::default();
        if small {
            options.method = Method::Sweep;
        }
        points::make_trusting(dataset, &options, terminal)?;
    }
    if with_bodies && dataset.manifest.bodies.is_none() {
        go_on(stop)?;
        match bodies::find(dataset, &BodyOptions::default(), terminal) {
            Ok(_) => {}
            Err(none @ (CloudError::NoBodies { .. } | CloudError::NoMovingPoints { .. })) => {
                terminal.note(format!("{}: {none}", dataset.root.display()));
            }
            Err(other) => return Err(other.into()),
        }
    }
    Ok(())
}
