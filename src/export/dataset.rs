//! Datasets in the layouts that other trainers read.

use std::path::{Path, PathBuf};

use erfgs_dataset::{
    Dataset,
    export::{Layout, export},
};
use serde::Serialize;

use crate::terminal::{Terminal, thousands};

#[derive(Serialize)]
struct Summary<'a> {
    out: &'a Path,
    images: u64,
    points: u64,
    notes: &'a [String],
}

/// Writes the folder and says what it holds.
pub fn run(input: &Path, layout: Layout, out: &PathBuf, terminal: &Terminal) -> anyhow::Result<()> {
    let dataset = Dataset::load(input)?;
    let progress = terminal.progress("exporting");
    let exported = export(&dataset, layout, out, &mut |now| progress.update(now.done, now.total, now.what))?;
    drop(progress);
    exported.notes.iter().for_each(|note| terminal.note(note));
    let summary = Summary { out, images: exported.images, points: exported.points, notes: &exported.notes };
    terminal.result(&summary, || {
        let (images, points) = (thousands(exported.images), thousands(exported.points));
        format!("{images} images and {points} points in {}", out.display())
    })
}
