//! `erfgs view`: what runs learned, in a browser.

use std::{
    net::SocketAddr,
    path::PathBuf,
    process::{Command, Stdio},
    sync::{atomic::Ordering, mpsc::RecvTimeoutError},
    time::Duration,
};

use erfgs_base::scratch::Scratch;
use erfgs_page::serve::PageOptions;
use erfgs_run::{PerView, RunFolder};
use erfgs_scene::image::ImageRgb8;
use erfgs_splat::{
    model::Rendered,
    raster::View,
    trained::{Record, TrainedScene},
};
use erfgs_view::{Ask, Compared, FrameError, Learned, Model, Precision, SceneFile, ViewPage, Window};
use serde::Serialize;

use crate::{
    device::{Adapter, TrainedRun},
    errors::Usage,
    interrupt::stop_flag,
    takes::{self, OpenTake},
    terminal::{Terminal, bytes, thousands},
};

/// Look at what a run learned, at any time from any place, in a browser; two runs are shown side by side, and the windows of a long
/// take that a sweep trained one after another.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The page draws on the graphics processor of the machine that the browser runs on (WebGPU), with the kernels of the trainer.
For a browser without WebGPU this machine renders the pictures. Time can be dragged, slowed down to 1/1000 and stopped while \
you move around; you can look through the cameras of the rig, with the recorded frames over the rendering. The address in the \
browser contains time and viewpoint, for links.

Browsers offer WebGPU only to pages from their own machine or over https: from another machine, forward the port.

Examples:
  erfgs view run-erf
  erfgs view run-4dgs run-erf
  erfgs view throw.e4d
  erfgs view sweep --take dance-s0
  erfgs view run-erf --address 127.0.0.1:8200 --no-browser    # and where you sit: ssh -L 8200:localhost:8200 HOST")]
pub struct Arguments {
    /// Run folders, as `erfgs train --out` wrote them, or scene files of `erfgs export --to e4d`; the second one is seen right
    /// of a line that can be moved. Or the folder of a sweep with windows of a take.
    #[arg(required = true, num_args = 1..=2, value_name = "RUN|S.e4d|SWEEP")]
    runs: Vec<PathBuf>,
    /// Which take, where the sweep has several: of a combination of settings and a seed.
    #[arg(long, value_name = "NAME")]
    take: Option<String>,
    /// The dataset, where it is no longer where the runs were trained on it.
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Address to listen at; port 0 takes any free one.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8200")]
    address: SocketAddr,
    /// A host name under which browsers may open the page, besides localhost and IP addresses.
    #[arg(long = "name", value_name = "NAME")]
    names: Vec<String>,
    /// Only print the link.
    #[arg(long)]
    no_browser: bool,
    #[command(flatten)]
    adapter: Adapter,
}

#[derive(Serialize)]
struct Served {
    link: String,
    models: Vec<ServedModel>,
}

#[derive(Serialize)]
struct ServedModel {
    name: String,
    gaussians: usize,
    moving: usize,
    bytes: usize,
}

/// Serves the page until it is interrupted.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    // A scene file is drawn by browsers alone.
    let is_file = |path: &PathBuf| path.is_file();
    let gpu = if arguments.runs.iter().all(is_file) { None } else { Some(arguments.adapter.open()?) };
    // Who draws for browsers that cannot: each run, or the take.
    let mut scenes = Vec::new();
    let mut take: Option<OpenTake<'_>> = None;
    let mut models = Vec::new();
    for path in &arguments.runs {
        let Some(gpu) = gpu.as_ref().filter(|_| !is_file(path)) else {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            models.push(Model { name, scene: SceneFile::open(path)?, dataset: None, errors: Vec::new(), window: None });
            scenes.push(None);
            continue;
        };
        if let Some(windows) = takes::windows(path, arguments.take.as_deref(), &arguments.adapter, terminal)? {
            if arguments.runs.len() > 1 {
                return Err(Usage("a take cannot be compared: give the folder of a single sweep".into()).into());
            }
            let progress = terminal.progress("reading windows");
            let count = windows.len() as u64;
            for (at, window) in windows.iter().enumerate() {
                progress.update(at as u64, count, "windows");
                models.push(model(
                    &window.run,
                    &window.folder,
                    &window.scene(gpu)?,
                    Some(window.window.clone()),
                    terminal,
                ));
            }
            take = Some(OpenTake::new(gpu, windows));
            continue;
        }
        let run = TrainedRun::new(path, arguments.dataset.as_deref(), &arguments.adapter);
        let folder = run.folder()?;
        let scene = run.scene(gpu, &folder)?;
        models.push(model(&run, &folder, &scene, None, terminal));
        scenes.push(Some(scene));
    }
    let served = models.iter().map(|model| ServedModel {
        name: model.name.clone(),
        gaussians: model.scene.header.count,
        moving: model.scene.header.dynamic,
        bytes: model.scene.bytes.len(),
    });
    let served: Vec<ServedModel> = served.collect();
    let options = PageOptions { address: arguments.address, names: arguments.names.clone(), open: false };
    let (page, asks) = ViewPage::serve(models, None, &options)?;
    let stop = stop_flag("the page ends")?;
    let result = Served { link: page.url(), models: served };
    terminal.result(&result, || {
        let line = |model: &ServedModel| {
            let ServedModel { name, gaussians, moving, bytes: size } = model;
            let (gaussians, moving) = (thousands(*gaussians as u64), thousands(*moving as u64));
            format!("{name}: {gaussians} Gaussians, {moving} move, {}", bytes(*size as u64))
        };
        let lines: Vec<String> = result.models.iter().map(line).collect();
        format!("{}\n{}", lines.join("\n"), result.link)
    })?;
    terminal.note("Ctrl-C ends the page");
    // Kept until the page ends: a browser may take its time.
    let _entrance = if arguments.no_browser { None } else { open_browser(&page) };
    let mut shown = 0;
    while !stop.load(Ordering::Relaxed) {
        for Compared { camera, t01, mode, psnr_db, worst } in page.compared().into_iter().skip(shown) {
            shown += 1;
            terminal.note(format!(
                "{camera} at {t01:.2}, {mode}: {psnr_db:.1} dB against this machine's rendering, {worst} of 255 at most"
            ));
        }
        match asks.recv_timeout(Duration::from_millis(200)) {
            // Who asked has left, or looks from somewhere else by now.
            Ok(ask) if ask.is_abandoned() => {}
            Ok(ask) => match (&mut take, scenes.get_mut(ask.model)) {
                (Some(take), _) => match take.window(ask.model) {
                    Ok(scene) => answer(ask, |view, t01| scene.render(view, t01)),
                    Err(error) => drop(ask.answer.send(Err(format!("{error:#}")))),
                },
                (None, Some(Some(scene))) => answer(ask, |view, t01| scene.render(view, t01)),
                // Who asked may have left.
                _ => drop(ask.answer.send(Err("the server cannot draw a scene file; the browser can".into()))),
            },
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    Ok(())
}

/// What the page shows of a run. Without its dataset there are no recorded frames to compare with.
fn model(
    run: &TrainedRun,
    folder: &RunFolder,
    scene: &TrainedScene<'_>,
    window: Option<Window>,
    terminal: &Terminal,
) -> Model {
    let dataset = run.dataset(folder);
    if let Err(error) = &dataset {
        terminal.note(format!("{} is shown without recorded frames: {error:#}", folder.name()));
    }
    let errors = errors(folder, scene.record());
    let scene = Learned::of(scene.learned()).file(Precision::Exact);
    Model { name: folder.name(), scene, dataset: dataset.ok(), errors, window }
}

/// How well the run shows held-out frames, where `erfgs eval` has measured it.
fn errors(folder: &RunFolder, record: &Record) -> Vec<FrameError> {
    let of = |view: PerView| FrameError { camera: view.camera, t01: record.to_unit(view.t_ns), psnr_db: view.psnr };
    folder.read_per_view().unwrap_or_default().into_iter().map(of).collect()
}

/// Draws what a page asks for, unless it does not wait for it any more.
pub fn answer<E: std::fmt::Display>(ask: Ask, render: impl FnOnce(&View, f64) -> Result<Rendered, E>) {
    if ask.is_abandoned() {
        return;
    }
    let drawn = render(&ask.view, ask.t01).map_err(|error| error.to_string());
    let picture = drawn.map(|drawn| {
        let (width, height) = (ask.view.width, ask.view.height);
        ImageRgb8 { width, height, data: drawn.to_bytes() }
    });
    // Who asked may have left.
    let _ = ask.answer.send(picture);
}

/// Opens a browser where there is a screen; where there is none the link was printed. Command lines are read by all users of a machine:
/// the browser is given a private file, which leads to the page.
fn open_browser(page: &ViewPage) -> Option<Scratch> {
    let has_screen = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let program = if cfg!(target_os = "macos") {
        "open"
    } else if has_screen("DISPLAY") || has_screen("WAYLAND_DISPLAY") {
        "xdg-open"
    } else {
        return None;
    };
    let entrance = || -> anyhow::Result<(Scratch, PathBuf)> {
        let (folder, url) = (Scratch::new()?, page.url_for_once()?);
        let file = folder.path().join("page.html");
        let text =
            format!("<!doctype html><meta charset=\"utf-8\"><meta http-equiv=\"refresh\" content=\"0; url={url}\">");
        std::fs::write(&file, text)?;
        Ok((folder, file))
    };
    let (folder, file) = match entrance() {
        Ok(entrance) => entrance,
        Err(error) => {
            tracing::debug!("no browser was opened: {error:#}");
            return None;
        }
    };
    let started =
        Command::new(program).arg(&file).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    if let Err(error) = started {
        tracing::debug!("no browser was opened: {program}: {error}");
    }
    Some(folder)
}
