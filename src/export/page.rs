//! A run as a page of one file.

use std::path::{Path, PathBuf};

use erfgs_base::atomic;
use erfgs_view::{SceneFile, alone};
use serde::Serialize;

use crate::{
    device::TrainedRun,
    errors::Usage,
    terminal::{Terminal, bytes, thousands},
};

#[derive(Serialize)]
struct Exported {
    file: PathBuf,
    gaussians: usize,
    bytes: u64,
}

/// Writes the page, `view.html` in the run's folder without `out`.
pub fn run(run: &TrainedRun, out: Option<&Path>, force: bool, terminal: &Terminal) -> anyhow::Result<()> {
    let folder = run.folder()?;
    let file = out.map_or_else(|| folder.root().join("view.html"), Path::to_owned);
    if file.exists() && !force {
        let what = format!("'{}' exists already; --force overwrites it, or give another --out", file.display());
        return Err(Usage(what).into());
    }
    let gpu = run.device()?;
    let trainer = run.trainer(&gpu, &folder)?;
    let scene = SceneFile::of(&trainer)?;
    if let Some(beyond) = &scene.header.only_server {
        anyhow::bail!(
            "a browser cannot draw this run by itself: {beyond}; look at it with `erfgs view {}`",
            run.run.display()
        );
    }
    let name = folder.name();
    let page = alone::page(&[alone::Packed { name: &name, scene: &scene }])?;
    atomic::write(&file, page.as_bytes()).map_err(erfgs_base::FileError::when("write", &file))?;
    let exported = Exported { file, gaussians: scene.header.count, bytes: page.len() as u64 };
    terminal.result(&exported, || {
        let size = bytes(exported.bytes);
        format!(
            "{}: {} Gaussians, {size}; it opens from a disk",
            exported.file.display(),
            thousands(exported.gaussians as u64)
        )
    })
}
