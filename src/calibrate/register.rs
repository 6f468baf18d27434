//! `erfgs calibrate register`: cameras added to a calibrated rig.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use erfgs_base::order::natural;
use erfgs_calibrate::{
    intensity::{LogIntensity, dark_ramp, leaky},
    sfm::{CameraView, RegisterOptions, read_model_views, reduced, register},
};
use erfgs_events::{Columns, EventFile, EventFileHints, Events, npz};
use erfgs_points::ColmapProgram;
use erfgs_scene::rig_file::RigFile;
use erfgs_scene::{Modality, image::ImageGrey8};

use super::{steps::Steps, summary::finish};
use crate::{errors::Usage, event_file::TextOptions, terminal::Terminal};

/// Add cameras to a calibrated rig, from images of what its cameras see too.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The rig's cameras keep their poses. A new camera is placed against points that the rig's images give, and adjusted to further \
ones. It needs intrinsics: an entry without pose in the rig file, or --intrinsics.

INPUT is a folder with one file for each new camera, named as the camera: an image, or an event file (npz, raw, dat, aedat, csv). \
Edges and polarity frames match nothing; what matches is intensity. An event camera that stands still sees it where light comes \
up from darkness:
  --dark-ramp      a shutter that opens, lamps that are turned up from off: recorded from the dark on; the time it takes does not \
matter; repeat it some times in one recording if the sensor is noisy
  --leaky SECONDS  the camera or the light moves: a leaky integral of the events up to this time

Examples:
  erfgs calibrate register --rig rgb-rig.json --model images --images ramps --dark-ramp --intrinsics event-intrinsics.json
  erfgs calibrate register --rig rgb-rig.json --model ds --images more --out rig.json")]
pub struct Arguments {
    /// The rig file.
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// Images of the rig's own cameras: as for `calibrate sfm`.
    #[arg(long, value_name = "INPUT")]
    model: PathBuf,
    /// Images or event files of the new cameras.
    #[arg(long, value_name = "INPUT")]
    images: PathBuf,
    /// Which image of each of the rig's cameras, from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: usize,
    /// A rig file with the intrinsics of the new cameras.
    #[arg(long, value_name = "RIG")]
    intrinsics: Option<PathBuf>,
    /// Event files hold light that rises from darkness, once or several times.
    #[arg(long, conflicts_with = "leaky")]
    dark_ramp: bool,
    /// Event files hold movement; integrate up to this time, seconds after the first event.
    #[arg(long, value_name = "SECONDS", value_parser = crate::parse::seconds)]
    leaky: Option<f64>,
    #[command(flatten)]
    text: TextOptions,
    /// Corner frequency of the leaky integral.
    #[arg(long, value_name = "HZ", default_value_t = 0.7, value_parser = crate::parse::within(0.0, 1e6))]
    cutoff_hz: f64,
    /// Contrast threshold of the event cameras, natural-log intensity; only its sign and the mixture of both polarities matter.
    #[arg(long, value_name = "C", default_value_t = 0.2, value_parser = crate::parse::within(1e-6, 100.0))]
    threshold: f64,
    /// Longest side, pixels, of the pictures in which features are looked for (they are enlarged to twice their size at
    /// most); by default as large as this machine handles in some minutes.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(64..))]
    feature_side: Option<u32>,
    /// The COLMAP to use: a program, `pycolmap`, or `pycolmap:PYTHON`. Default: searched for.
    #[arg(long, value_name = "PROGRAM")]
    colmap: Option<ColmapProgram>,
    /// Number of threads. Default: all cores.
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// The rig file to write; the report goes beside it, with the extension html.
    #[arg(long, value_name = "FILE", default_value = "rig.json")]
    out: PathBuf,
}

/// Registers.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let rig = RigFile::read(&arguments.rig)?;
    let intrinsics = arguments.intrinsics.as_deref().map(RigFile::read).transpose()?;
    let mut options = RegisterOptions {
        colmap: arguments.colmap.clone().unwrap_or_default(),
        threads: arguments.jobs.unwrap_or(0),
        ..RegisterOptions::default()
    };
    let model = read_model_views(&arguments.model, arguments.frame, &rig)?;
    let mut new = Vec::new();
    for file in files(&arguments.images)? {
        let name = file.file_stem().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let known = intrinsics.as_ref().and_then(|rig| rig.camera(&name)).or_else(|| rig.camera(&name));
        let Some(known) = known else {
            bail!("{}: there are no intrinsics of camera '{name}'; give them with --intrinsics", file.display());
        };
        if model.iter().any(|view| view.name == name) {
            terminal.note(format!("{name} is one of the rig's own cameras, and is left out"));
            continue;
        }
        let size = [known.intrinsics.width, known.intrinsics.height];
        let (image, modality) = picture(&file, size, arguments, options.radius_px, terminal)?;
        new.push(CameraView { name, modality, image, intrinsics: Some(known.intrinsics), chosen: None });
    }
    if new.is_empty() {
        bail!("{} holds no image and no event file of a new camera", arguments.images.display());
    }
    let work = erfgs_base::scratch::Scratch::new().context("cannot make a folder for intermediate files")?;
    let all: Vec<CameraView> = model.iter().chain(&new).cloned().collect();
    if let Some(smaller) = reduced(&all, options.setting.enlarge, options.threads, arguments.feature_side) {
        options.setting.enlarge *= smaller.factor;
        terminal.note(smaller.to_string());
    }
    drop(all);
    let (rig, evidence) =
        Steps::new(terminal, None).during(|tell| register(&rig, &model, &new, &options, work.path(), tell))?;
    finish(&rig, &evidence, &arguments.out, terminal)
}

fn files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let listing = || format!("cannot list {}", folder.display());
    let entries = std::fs::read_dir(folder).with_context(listing)?;
    let mut files: Vec<PathBuf> =
        entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>().with_context(listing)?;
    files.retain(|file| file.is_file());
    files.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(files)
}

/// An image as it is, or a picture of events.
fn picture(
    file: &Path,
    size: [u32; 2],
    arguments: &Arguments,
    radius_px: u32,
    terminal: &Terminal,
) -> anyhow::Result<(ImageGrey8, Modality)> {
    let extension = file.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    if matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg")) {
        let modality = if arguments.dark_ramp || arguments.leaky.is_some() { Modality::Event } else { Modality::Rgb };
        return Ok((ImageGrey8::read(file)?, modality));
    }
    let events = match extension.as_deref() {
        Some("npz") => npz::read_events(file, Some(size))?,
        extension => {
            let is_text = matches!(extension, Some("csv" | "txt"));
            decoded(file, size, &if is_text { arguments.text.hints() } else { EventFileHints::default() }, terminal)?
        }
    };
    let log: LogIntensity = if arguments.dark_ramp {
        dark_ramp(&events, arguments.threshold)
    } else if let Some(seconds) = arguments.leaky {
        let first = events.t_us.first().copied().unwrap_or(0);
        leaky(&events, arguments.threshold, arguments.cutoff_hz, first + (1e6 * seconds) as i64)
    } else {
        return Err(Usage(format!(
            "{} holds events: state with --dark-ramp or --leaky SECONDS how to reconstruct intensity from them",
            file.display()
        ))
        .into());
    };
    Ok((log.picture(radius_px), Modality::Event))
}

fn decoded(
    path: &Path,
    [width, height]: [u32; 2],
    hints: &EventFileHints,
    terminal: &Terminal,
) -> anyhow::Result<Events> {
    let mut columns = Columns::default();
    let file = EventFile::open_with(path, hints)?;
    if let Some(other) = file.size.filter(|size| [size.width, size.height].map(u32::from) != [width, height]) {
        bail!(
            "{} is of a sensor of {}x{} pixels, and the intrinsics of that camera are for {width}x{height}: give the camera's own file, or \
             intrinsics of that size",
            path.display(),
            other.width,
            other.height
        );
    }
    let anomalies = file.decode(&mut columns)?;
    if columns.is_empty() {
        bail!("{} holds no event that can be read: {anomalies}", path.display());
    }
    if !anomalies.is_empty() {
        terminal.note(format!("{}: {anomalies}", path.display()));
    }
    let mut events = Events::new(width, height);
    for index in 0..columns.len() {
        events.push(erfgs_events::Event {
            t_us: columns.t_us[index] as i64,
            x: columns.x[index],
            y: columns.y[index],
            on: columns.on[index],
        });
    }
    Ok(events)
}
