//! `erfgs info`: what a session, a dataset, a run, a point cloud or an event file holds.

mod bodies;
mod events;
mod hot_pixels;
mod session;
mod settings;

use std::path::{Path, PathBuf};

use erfgs_dataset::{Dataset, Split};
use erfgs_events::{EventFile, EventFileError};
use erfgs_run::{Metrics, RunFolder, RunInfo};
use erfgs_scene::{Modality, PointCloud};
use erfgs_session::container::recording_file;
use serde::Serialize;

use crate::{
    errors::Usage,
    event_file::EventFileOptions,
    progress::duration,
    terminal::{Terminal, bytes, table, thousands},
};

/// Say what a session, a dataset, a run, a point cloud or an event file holds.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs info ds-dv
  erfgs info run --json | jq .metrics.psnr
  erfgs info ds-dv/events/03.npz
  erfgs info recording.raw --digest --json
  erfgs info events.h5 --digest
  erfgs info S.mcap
  erfgs info S.mcap --check
  erfgs info S.mcap --hot-pixels")]
pub struct Arguments {
    /// A session, a dataset or run folder, a .ply point cloud, or an event file.
    path: PathBuf,
    /// Read all of a session and verify its checksums; exit code 1 if anything is damaged.
    #[arg(long)]
    check: bool,
    /// Print the SHA3-224 of each field of the events of an event file or a session.
    #[arg(long)]
    digest: bool,
    /// List the pixels of event cameras that send events all the time, whatever they look at, and how to mask them.
    #[arg(long, conflicts_with_all = ["check", "digest"])]
    hot_pixels: bool,
    #[command(flatten)]
    file_is: EventFileOptions,
}

/// Looks at what `path` is and describes it.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let path = &*recording_file(&arguments.path)?;
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let folder = if path.is_file() { path.parent().unwrap_or(Path::new(".")) } else { path };
    let file_name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let of_events = [("--digest", arguments.digest), ("--hot-pixels", arguments.hot_pixels)];
    if let Some((option, _)) = of_events.into_iter().find(|(_, is_given)| *is_given)
        && (path.is_dir() || extension == "ply" || extension == "json")
    {
        let what = format!("{option} is for sessions and event files, and '{}' is none", path.display());
        return Err(Usage(what).into());
    }
    let hints = arguments.file_is.hints();
    let is_text =
        !path.is_dir() && !matches!(extension, "ply" | "json" | "mcap" | "db3" | "npz" | "npy" | "h5" | "hdf5");
    if hints.columns.is_some() && !is_text {
        return Err(Usage(format!("--columns is for events as text, and '{}' is none", path.display())).into());
    }
    let is_recording = matches!(extension, "mcap" | "db3");
    if arguments.check && !is_recording {
        return Err(Usage(format!("--check is for sessions, and '{}' is none", path.display())).into());
    }
    if arguments.hot_pixels {
        return hot_pixels::run(path, &hints, terminal);
    }
    match (path.is_dir(), extension) {
        (false, _) if is_recording && !path.exists() => Err(Usage(format!("'{}' does not exist", path.display())).into()),
        (false, "ply") => points(path, terminal),
        (false, _) if is_recording => session::run(path, arguments.digest, arguments.check, terminal),
        (false, "npz" | "npy") => events::describe_arrays(path, hints.size, arguments.digest, terminal),
        (false, "h5" | "hdf5") => events::describe_hdf5(path, hints.size, arguments.digest, terminal),
        // A run keeps a copy of its dataset's manifest, so that run.json is looked for first.
        (true, _) if folder.join("run.json").is_file() => run_folder(folder, terminal),
        (true, _) => dataset(&Dataset::load(folder)?, terminal),
        (false, _) if file_name == "run.json" => run_folder(folder, terminal),
        (false, _) if file_name == Dataset::MANIFEST => dataset(&Dataset::load(folder)?, terminal),
        (false, _) if !path.exists() => Err(Usage(format!("'{}' does not exist", path.display())).into()),
        (false, _) => match EventFile::open_with(path, &hints) {
            Err(error @ EventFileError::Unknown { .. }) => Err(Usage(format!(
                "'{}' has no format that erfgs knows: give a session, a dataset or run folder, a .ply or an event file ({error})",
                path.display()
            ))
            .into()),
            opened => events::describe(&opened?, arguments.digest, terminal),
        },
    }
}

#[derive(Serialize)]
struct DatasetSummary<'a> {
    kind: &'static str,
    folder: &'a Path,
    name: &'a str,
    importer: &'a str,
    cameras: usize,
    train_rgb: usize,
    train_event: usize,
    train_both: usize,
    test: usize,
    frames: usize,
    width: u32,
    height: u32,
    distorted_cameras: usize,
    span_seconds: f64,
    events: u64,
    masks: usize,
    points: Option<u64>,
    bodies: Option<Vec<bodies::BodySummary>>,
    steps: Vec<String>,
}

/// Describes a dataset.
pub fn dataset(dataset: &Dataset, terminal: &Terminal) -> anyhow::Result<()> {
    let manifest = &dataset.manifest;
    let frames = || manifest.cameras.iter().flat_map(|camera| &camera.frames);
    let train = |modality| dataset.cameras(Split::Train).filter(|camera| camera.modality == modality).count();
    let size = manifest.cameras.first().map_or((0, 0), |camera| (camera.intrinsics.width, camera.intrinsics.height));
    let summary = DatasetSummary {
        kind: "dataset",
        folder: &dataset.root,
        name: &manifest.name,
        importer: &manifest.provenance.importer,
        cameras: manifest.cameras.len(),
        train_rgb: train(Modality::Rgb),
        train_event: train(Modality::Event),
        train_both: train(Modality::Both),
        test: dataset.cameras(Split::Test).count(),
        frames: frames().count(),
        width: size.0,
        height: size.1,
        distorted_cameras: manifest
            .cameras
            .iter()
            .filter(|camera| camera.intrinsics.distortion != erfgs_scene::Distortion::None)
            .count(),
        span_seconds: (manifest.span_ns[1] - manifest.span_ns[0]) as f64 * 1e-9,
        events: manifest.cameras.iter().filter_map(|camera| camera.events.as_ref()).map(|events| events.count).sum(),
        masks: frames().filter(|frame| frame.mask.is_some()).count(),
        points: manifest.points.as_ref().map(|points| points.count),
        bodies: bodies::of(dataset)?,
        steps: manifest.variant.iter().map(|step| step.step.clone()).collect(),
    };
    terminal.result(&summary, || describe_dataset(&summary))
}

fn describe_dataset(summary: &DatasetSummary<'_>) -> String {
    let steps = if summary.steps.is_empty() { "none".to_owned() } else { summary.steps.join(", ") };
    let mut rows = vec![
        ("dataset", format!("{} ({}), imported from {}", summary.name, summary.folder.display(), summary.importer)),
        (
            "cameras",
            format!(
                "{}: train on {} RGB, {} event, {} with both; {} held out",
                summary.cameras, summary.train_rgb, summary.train_event, summary.train_both, summary.test
            ),
        ),
        ("images", format!("{} of {} x {}", thousands(summary.frames as u64), summary.width, summary.height)),
        ("time", format!("{:.3} s", summary.span_seconds)),
        ("events", thousands(summary.events)),
        ("masks", summary.masks.to_string()),
        ("steps", steps),
        ("points", summary.points.map_or("none; `erfgs dataset points` makes them".into(), thousands)),
    ];
    for (number, body) in summary.bodies.iter().flatten().enumerate() {
        rows.push((if number == 0 { "bodies" } else { "" }, body.line()));
    }
    if summary.distorted_cameras > 0 {
        let text =
            format!("{} cameras; `erfgs dataset undistort` removes it before training", summary.distorted_cameras);
        rows.push(("distortion", text));
    }
    key_value(rows)
}

fn key_value(rows: Vec<(&str, String)>) -> String {
    table(&rows.into_iter().map(|(key, value)| vec![key.to_owned(), value]).collect::<Vec<_>>())
}

#[derive(Serialize)]
struct RunSummary<'a> {
    kind: &'static str,
    folder: &'a Path,
    run: RunInfo,
    metrics: Option<Metrics>,
    iterations: u64,
    train_seconds: f64,
    gaussians: u64,
    checkpoint_bytes: Option<u64>,
}

fn run_folder(path: &Path, terminal: &Terminal) -> anyhow::Result<()> {
    let folder = RunFolder::open(path)?;
    let last = folder.read_curve().ok().and_then(|curve| curve.rows.last().cloned()).unwrap_or_default();
    let metrics = if folder.metrics_file().is_file() { Some(folder.read_metrics()?) } else { None };
    let summary = RunSummary {
        kind: "run",
        folder: path,
        run: folder.read_info()?,
        metrics,
        iterations: last.iteration,
        train_seconds: last.wall_seconds,
        gaussians: last.gaussians,
        checkpoint_bytes: folder.checkpoint_file().metadata().ok().map(|metadata| metadata.len()),
    };
    terminal.result(&summary, || describe_run(&summary))
}

fn describe_run(summary: &RunSummary<'_>) -> String {
    let run = &summary.run;
    let mut rows = vec![
        ("run", format!("{}: {}, preset {}, seed {}", summary.folder.display(), run.method, run.preset, run.seed)),
        ("dataset", format!("{} ({})", run.dataset_name, run.dataset.display())),
        ("adapter", format!("{}, {}", run.adapter, run.driver)),
        ("trained", format!("{} iterations in {}", thousands(summary.iterations), duration(summary.train_seconds))),
        ("gaussians", thousands(summary.gaussians)),
        (
            "checkpoint",
            summary
                .checkpoint_bytes
                .map_or("none".into(), |size| format!("{}; `erfgs train --resume` continues", bytes(size))),
        ),
    ];
    if !run.bodies.is_empty() {
        rows.push(("bodies", format!("{}: {}", run.bodies.len(), run.bodies.join(", "))));
    }
    match &summary.metrics {
        Some(metrics) => {
            let decibels = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.2} dB"));
            rows.push((
                "held out",
                format!(
                    "PSNR {}, DPSNR {} (masks: {}), SSIM {:.3}",
                    decibels(Some(metrics.psnr)),
                    decibels(metrics.dpsnr),
                    metrics.dpsnr_mask,
                    metrics.ssim
                ),
            ));
        }
        None => rows.push(("held out", "not measured; `erfgs eval` does".into())),
    }
    for left_out in &run.left_out {
        rows.push(("left out", left_out.to_string()));
    }
    key_value(rows)
}

#[derive(Serialize)]
struct PointSummary<'a> {
    kind: &'static str,
    file: &'a Path,
    points: usize,
    lower_m: [f32; 3],
    upper_m: [f32; 3],
}

fn points(path: &Path, terminal: &Terminal) -> anyhow::Result<()> {
    let cloud = PointCloud::read(path)?;
    let bound = |pick: fn(f32, f32) -> f32| {
        cloud
            .positions
            .iter()
            .copied()
            .reduce(|a, b| std::array::from_fn(|axis| pick(a[axis], b[axis])))
            .unwrap_or_default()
    };
    let summary = PointSummary {
        kind: "points",
        file: path,
        points: cloud.len(),
        lower_m: bound(f32::min),
        upper_m: bound(f32::max),
    };
    terminal.result(&summary, || {
        let corner = |corner: [f32; 3]| corner.map(|value| format!("{value:.3}")).join(", ");
        key_value(vec![
            ("points", thousands(summary.points as u64)),
            ("lower corner", format!("{} m", corner(summary.lower_m))),
            ("upper corner", format!("{} m", corner(summary.upper_m))),
        ])
    })
}
