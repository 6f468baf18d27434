//! `erfgs report`: runs compared in one HTML file.

use std::path::{Path, PathBuf};

use erfgs_report::{Extras, write_report};
use erfgs_run::{Metrics, RunFolder};
use erfgs_sweep::Manifest;
use erfgs_view::{
    Learned, Precision, SceneFile,
    alone::{self, Packed},
};
use serde::Serialize;

use crate::{
    device::{Adapter, TrainedRun},
    errors::Usage,
    terminal::{Terminal, bytes, table, thousands},
};

/// Runs that a view shows side by side.
const VIEWED: usize = 2;

/// Compare runs in one self-contained HTML file.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The page needs no other file and no network: error against run time of all runs in one plot, error against time between \
frames, tables per scene and per view, pictures side by side, what was left out and why, settings that differ. Differences \
are relative to the first run. The page includes the view of the first two runs, as `erfgs export --to html` writes it.

Examples:
  erfgs report run-4dgs run-erf --out report.html
  erfgs report sweep --out report.html
  erfgs report run-4dgs run-erf --oracle run-all-frames --out report.html
  erfgs report run --out report.html --json | jq '.runs[0].metrics.dpsnr'")]
pub struct Arguments {
    /// Run folders, or folders of sweeps, whose finished runs are taken.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// A run of 4DGS on all frames, sharp, evaluated on the same held-out frames: the page says how much of the gap to it
    /// events close.
    #[arg(long, value_name = "RUN")]
    oracle: Option<PathBuf>,
    /// Leave the view out, with its 2 MB a run; no device is then needed.
    #[arg(long)]
    no_view: bool,
    #[command(flatten)]
    adapter: Adapter,
    /// The page to write.
    #[arg(long, value_name = "REPORT.html")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Summary<'a> {
    out: &'a Path,
    bytes: u64,
    notes: Vec<String>,
    runs: Vec<RunRow>,
}

#[derive(Serialize)]
struct RunRow {
    run: String,
    method: String,
    metrics: Option<Metrics>,
}

/// Writes the page and prints the table of runs.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut notes = Vec::new();
    let folders = folders(&arguments.runs, &mut notes)?;
    let oracle = arguments.oracle.as_ref().map(RunFolder::open).transpose()?;
    let view = if arguments.no_view { None } else { view(arguments, &folders, &mut notes) };
    let extras = Extras { oracle: oracle.as_ref(), view: view.as_deref() };
    let report = write_report(&folders, extras, &arguments.out)?;
    notes.extend(report.notes);
    let runs = folders
        .iter()
        .map(|folder| {
            let metrics = if folder.metrics_file().is_file() { Some(folder.read_metrics()?) } else { None };
            Ok(RunRow { run: folder.name(), method: folder.read_info()?.method, metrics })
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    let summary = Summary { out: &arguments.out, bytes: report.bytes, notes, runs };
    terminal.result(&summary, || describe(&summary))
}

/// The runs at these paths; of a sweep, those that are done so far.
fn folders(paths: &[PathBuf], notes: &mut Vec<String>) -> anyhow::Result<Vec<RunFolder>> {
    let mut folders = Vec::new();
    for path in paths {
        if !Manifest::is_in(path) {
            folders.push(RunFolder::open(path)?);
            continue;
        }
        let sweep = Manifest::load(path)?;
        let done = sweep.done();
        if done.len() < sweep.jobs.len() {
            notes.push(format!("{}: {} of {} runs are done", path.display(), done.len(), sweep.jobs.len()));
        }
        folders.extend(done);
    }
    if folders.is_empty() {
        return Err(Usage("no run of the sweep is done yet; `erfgs sweep --status` shows their state".into()).into());
    }
    Ok(folders)
}

/// The view of the first runs. A report is whole without: what keeps a run from being shown is noted.
fn view(arguments: &Arguments, folders: &[RunFolder], notes: &mut Vec<String>) -> Option<String> {
    let scene = |folder: &RunFolder| -> anyhow::Result<_> {
        let run = TrainedRun::new(folder.root(), None, &arguments.adapter);
        let gpu = run.device()?;
        Ok(Learned::of(run.scene(&gpu, folder)?.learned()).file(Precision::Packed))
    };
    let mut scenes: Vec<(String, SceneFile)> = Vec::new();
    let same_rig = |one: &SceneFile, other: &SceneFile| {
        let rig =
            |scene: &SceneFile| scene.header.cameras.iter().map(|own| (own.name.clone(), own.view)).collect::<Vec<_>>();
        rig(one) == rig(other)
    };
    for folder in folders.iter().take(VIEWED) {
        match scene(folder).map(|scene| (scene.header.only_server.clone(), scene)) {
            // Side by side stand runs on one recording.
            Ok((_, scene)) if scenes.first().is_some_and(|(_, first)| !same_rig(first, &scene)) => {}
            Ok((None, scene)) => scenes.push((folder.name(), scene)),
            Ok((Some(beyond), _)) => {
                notes.push(format!("{}: browsers cannot draw it ({beyond}); see `erfgs view`", folder.name()));
            }
            Err(error) => notes.push(format!("{}: not in the view: {error:#}", folder.name())),
        }
    }
    let packed: Vec<Packed<'_>> = scenes.iter().map(|(name, scene)| Packed { name, scene, window: None }).collect();
    if packed.is_empty() { None } else { alone::page(&packed).ok() }
}

fn describe(summary: &Summary<'_>) -> String {
    let heading = ["run", "method", "PSNR", "DPSNR", "SSIM", "iterations", "seconds", "Gaussians", "frames/s"];
    let mut rows = vec![heading.map(String::from).to_vec()];
    for row in &summary.runs {
        let figures = match &row.metrics {
            Some(metrics) => vec![
                format!("{:.2}", metrics.psnr),
                metrics.dpsnr.map_or("-".into(), |value| format!("{value:.2}")),
                format!("{:.4}", metrics.ssim),
                thousands(metrics.iterations),
                format!("{:.0}", metrics.train_seconds),
                thousands(metrics.gaussians),
                format!("{:.1}", metrics.render_fps),
            ],
            None => vec!["-".to_owned(); heading.len() - 2],
        };
        rows.push([row.run.clone(), row.method.clone()].into_iter().chain(figures).collect());
    }
    let mut text = table(&rows);
    for note in &summary.notes {
        text.push_str(&format!("note: {note}\n"));
    }
    text.push_str(&format!("\n{} ({})\n", summary.out.display(), bytes(summary.bytes)));
    text
}
