//! What the trainings of a measurement start from: points and bodies of the datasets that it makes.

use erfgs_dataset::Dataset;
use erfgs_points::{BodyOptions, CloudError, CloudOptions, Method};

use crate::{
    dataset::{bodies, points},
    terminal::Terminal,
};

/// Gives a dataset what it lacks: points, for which its cameras are trusted however wrong they are, and bodies where they are wanted and
/// something shows them. Features need larger pictures than `small` ones.
pub fn give(dataset: &mut Dataset, small: bool, with_bodies: bool, terminal: &Terminal) -> anyhow::Result<()> {
    if dataset.manifest.points.is_none() {
        let mut options = CloudOptions::default();
        if small {
            options.method = Method::Sweep;
        }
        points::make_trusting(dataset, &options, terminal)?;
    }
    if with_bodies && dataset.manifest.bodies.is_none() {
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
