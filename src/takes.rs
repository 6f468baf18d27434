//! Long takes that a sweep trained in windows, as pages show them.

use std::{
    io::{Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

use anyhow::Context;
use erfgs_base::{FileError, atomic};
use erfgs_run::RunFolder;
use erfgs_splat::{gpu::Gpu, trained::TrainedScene};
use erfgs_sweep::{Manifest, TrainedTake, TrainedWindow};
use erfgs_view::{Learned, Precision, SceneFile, Window, alone, scene_file::fidelity};

use crate::{
    device::{Adapter, TrainedRun},
    errors::Usage,
    terminal::Terminal,
};

/// A window, and its run.
pub struct WindowRun {
    /// The run.
    pub run: TrainedRun,
    /// Its folder.
    pub folder: RunFolder,
    /// What of the take it shows.
    pub window: Window,
}

impl WindowRun {
    fn of(manifest: &Manifest, take: &TrainedTake<'_>, window: &TrainedWindow<'_>, adapter: &Adapter) -> Self {
        let &TrainedWindow { job, begins, from, until } = window;
        let folder = manifest.run(job);
        let run = TrainedRun::new(folder.root(), None, adapter);
        Self { run, folder, window: Window { take: take.name.clone(), begins, from, until } }
    }

    /// What it learned.
    pub fn scene<'a>(&self, gpu: &'a Gpu) -> anyhow::Result<TrainedScene<'a>> {
        self.run.scene(gpu, &self.folder)
    }
}

/// The windows of a take, where `path` is the folder of a sweep: of the one that is named, or of its only one.
pub fn windows(
    path: &Path,
    named: Option<&str>,
    adapter: &Adapter,
    terminal: &Terminal,
) -> anyhow::Result<Option<Vec<WindowRun>>> {
    if !Manifest::is_in(path) {
        return Ok(None);
    }
    let manifest = Manifest::load(path)?;
    let takes = manifest.takes();
    let shown = path.display();
    let names = || takes.iter().map(|take| take.name.as_str()).collect::<Vec<_>>().join(", ");
    let take = match (&takes[..], named) {
        ([], _) => {
            let why = format!("{shown} has no take of several windows; name one of the runs in {shown}/runs");
            return Err(Usage(why).into());
        }
        ([only], None) => only,
        (_, None) => return Err(Usage(format!("{shown} has several takes: choose one by --take: {}", names())).into()),
        (all, Some(name)) => match all.iter().find(|take| take.name == name) {
            Some(take) => take,
            None => return Err(Usage(format!("{shown} has no take '{name}'; it has {}", names())).into()),
        },
    };
    if take.windows.is_empty() {
        let why = format!("no window of {} is done yet; see `erfgs sweep {shown} --status`", take.name);
        return Err(Usage(why).into());
    }
    if take.missing > 0 {
        let all = take.missing + take.windows.len();
        terminal.note(format!("{} of {all} windows of {} are not done yet and are left out", take.missing, take.name));
    }
    Ok(Some(runs(&manifest, take, adapter)))
}

/// The runs of the windows of a take that are done.
pub fn runs(manifest: &Manifest, take: &TrainedTake<'_>, adapter: &Adapter) -> Vec<WindowRun> {
    take.windows.iter().map(|window| WindowRun::of(manifest, take, window, adapter)).collect()
}

/// That browsers draw a scene by themselves; why they do not.
pub fn browsers_draw(scene: &SceneFile, run: &Path) -> anyhow::Result<()> {
    match &scene.header.only_server {
        None => Ok(()),
        Some(beyond) => anyhow::bail!(
            "a browser cannot draw this run by itself: {beyond}; look at it with `erfgs view {}`",
            run.display()
        ),
    }
}

/// A take as one scene, of which the window is open that was wanted last.
pub struct OpenTake<'a> {
    gpu: &'a Gpu,
    windows: Vec<WindowRun>,
    open: Option<(usize, TrainedScene<'a>)>,
}

impl<'a> OpenTake<'a> {
    /// The take of these windows.
    pub fn new(gpu: &'a Gpu, windows: Vec<WindowRun>) -> Self {
        Self { gpu, windows, open: None }
    }

    /// How long it is, seconds.
    pub fn seconds(&self) -> f64 {
        let [first, last] = [self.windows.first(), self.windows.last()].map(|of| of.map(|of| &of.window));
        first.zip(last).map_or(0.0, |(first, last)| last.until - first.from)
    }

    /// The run of the first window.
    pub fn first(&self) -> Option<&WindowRun> {
        self.windows.first()
    }

    /// What a window learned.
    pub fn window(&mut self, number: usize) -> anyhow::Result<&mut TrainedScene<'a>> {
        if self.open.as_ref().is_none_or(|(open, _)| *open != number) {
            let window = self.windows.get(number).context("there is no such window")?;
            // The one before goes first: there may be no room for both.
            drop(self.open.take());
            self.open = Some((number, window.scene(self.gpu)?));
        }
        self.open.as_mut().map(|(_, scene)| scene).context("no window is open")
    }

    /// The window that shows what is seen so many seconds after the take's beginning, and the same instant in it, in [0, 1]. What is
    /// between windows that are there is shown by the one before.
    pub fn at(&mut self, seconds: f64) -> anyhow::Result<(&mut TrainedScene<'a>, f64)> {
        let from = self.windows.first().map_or(0.0, |first| first.window.from);
        let at = from + seconds;
        let number = self.windows.iter().rposition(|of| at >= of.window.from).unwrap_or(0);
        let (begins, until) = self.windows.get(number).map_or((0.0, 0.0), |of| (of.window.begins, of.window.until));
        let scene = self.window(number)?;
        let t01 = scene.record().share(at.min(until) - begins);
        Ok((scene, t01))
    }
}

/// A take as one page.
pub struct TakePage {
    /// The page.
    pub text: String,
    /// Gaussians of all windows.
    pub gaussians: usize,
    /// Of the pictures of its worst window against those of the run, where numbers were packed.
    pub psnr_db: Option<f64>,
}

/// Makes a page of one file that shows the windows one after another.
pub fn page(
    windows: &[WindowRun],
    precision: Precision,
    adapter: &Adapter,
    terminal: &Terminal,
) -> anyhow::Result<TakePage> {
    let gpu = adapter.open()?;
    let progress = terminal.progress("packing windows");
    let mut psnr_db: Option<f64> = None;
    let mut scenes: Vec<(String, SceneFile)> = Vec::new();
    for (at, window) in windows.iter().enumerate() {
        progress.update(at as u64, windows.len() as u64, "windows");
        let scene = window.scene(&gpu)?;
        let file = Learned::of(scene.learned()).file(precision);
        browsers_draw(&file, window.folder.root())?;
        if precision == Precision::Packed {
            let decibels = fidelity(scene, &file)?;
            psnr_db = Some(psnr_db.map_or(decibels, |worst| worst.min(decibels)));
        }
        scenes.push((window.folder.name(), file));
    }
    drop(progress);
    let packed: Vec<alone::Packed<'_>> = scenes
        .iter()
        .zip(windows)
        .map(|((name, scene), of)| alone::Packed { name, scene, window: Some(&of.window) })
        .collect();
    let gaussians = scenes.iter().map(|(_, scene)| scene.header.count).sum();
    Ok(TakePage { text: alone::page(&packed)?, gaussians, psnr_db })
}

/// Writes a page, and the folder that it is to lie in.
pub fn write_page(file: &Path, text: &str) -> anyhow::Result<()> {
    if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(FileError::when("create the folder", folder))?;
    }
    Ok(atomic::write(file, text.as_bytes()).map_err(FileError::when("write", file))?)
}

/// What stands at the end of a take's page, to know which trainings it shows; nothing where a run does not say how far it is.
pub fn mark(windows: &[WindowRun]) -> Option<String> {
    let trained = |window: &WindowRun| {
        let (info, curve) = (window.folder.read_info().ok()?, window.folder.read_curve().ok()?);
        let last = curve.rows.last()?;
        let identity = info.identity.unwrap_or_default();
        Some(format!("{identity} {} {} {}", last.iteration, last.gaussians, last.wall_seconds))
    };
    let trained: Option<Vec<String>> = windows.iter().map(trained).collect();
    // What a run says may be anything.
    let text: String = trained?.join(";").chars().filter(|&c| c != '>' && !c.is_control()).collect();
    Some(format!("\n<!-- trainings: {text} -->\n"))
}

/// Whether a page ends with a mark.
pub fn has_mark(file: &Path, mark: &str) -> bool {
    let read = || -> std::io::Result<Vec<u8>> {
        let mut page = std::fs::File::open(file)?;
        page.seek(SeekFrom::End(-i64::try_from(mark.len()).unwrap_or(i64::MAX)))?;
        let mut end = Vec::new();
        page.take(mark.len() as u64).read_to_end(&mut end)?;
        Ok(end)
    };
    read().is_ok_and(|end| end == mark.as_bytes())
}

/// Where the page of a take goes, where nobody says otherwise.
pub fn page_file(sweep: &Path, windows: &[WindowRun]) -> PathBuf {
    let name = windows.first().map_or("take", |first| &first.window.take);
    sweep.join("takes").join(format!("{name}.html"))
}
