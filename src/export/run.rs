//! The Gaussians of a run as PLY files.

use std::path::{Path, PathBuf};

use erfgs_base::{
    FileError,
    atomic::{Together, numbered},
};
use erfgs_run::RunFolder;
use erfgs_splat::ply::write_ply;
use serde::Serialize;

use crate::{
    device::TrainedRun,
    errors::{not_over, not_over_pictures},
    terminal::{Terminal, bytes},
};

#[derive(Serialize)]
struct Exported {
    file: PathBuf,
    /// Nanoseconds on the session clock; absent for the canonical Gaussians.
    t_ns: Option<i64>,
    gaussians: usize,
    bytes: u64,
}

/// Writes the files and lists them.
pub fn run(
    run: &TrainedRun,
    instants: Option<u32>,
    out: Option<&Path>,
    force: bool,
    terminal: &Terminal,
) -> anyhow::Result<()> {
    let folder = run.folder()?;
    let there = RunFolder::new(out.unwrap_or(folder.root()));
    let at_instants = there.point_clouds_at_folder();
    not_over_pictures(&at_instants, RunFolder::POINT_CLOUD_DIGITS, "ply", force)?;
    if out.is_some() {
        // The training left it in the run itself, and it is written as it was.
        not_over(&there.point_cloud_file(), force)?;
    }
    let gpu = run.device()?;
    let mut scene = run.scene(&gpu, &folder)?;
    let instants = instants.unwrap_or_else(|| {
        let held_out = scene.record().cameras.iter().filter(|camera| camera.held_out);
        let times: std::collections::BTreeSet<i64> =
            held_out.flat_map(|camera| &camera.frames_ns).map(|[t_ns, ..]| *t_ns).collect();
        times.len() as u32
    });
    let begun = Together::begin(&at_instants).map_err(FileError::when("write", &at_instants))?;
    let progress = terminal.progress("exporting");
    let mut files = Vec::new();
    let mut write = |file: &Path, shown: PathBuf, t_ns, gaussians| -> anyhow::Result<()> {
        write_ply(file, &gaussians)?;
        let bytes = std::fs::metadata(file).map_or(0, |metadata| metadata.len());
        files.push(Exported { file: shown, t_ns, gaussians: gaussians.len(), bytes });
        Ok(())
    };
    let canonical = there.point_cloud_file();
    write(&canonical, canonical.clone(), None, scene.gaussians_still()?)?;
    for index in 0..instants {
        progress.update(index.into(), instants.into(), "instants");
        let t01 = f64::from(index) / f64::from(instants.max(2) - 1);
        let t_ns = scene.record().from_unit(t01);
        let name = RunFolder::point_cloud_at_name(index);
        write(&begun.path().join(&name), at_instants.join(&name), Some(t_ns), scene.gaussians_at(t01)?)?;
    }
    if instants > 0 {
        let placed = begun.finish(numbered(RunFolder::POINT_CLOUD_DIGITS, "ply"));
        placed.map_err(FileError::when("write", &at_instants))?;
    }
    drop(progress);
    terminal.result(&files, || {
        let total: u64 = files.iter().map(|file| file.bytes).sum();
        format!("{} files, {}, in {}", files.len(), bytes(total), there.root().display())
    })
}
