//! `erfgs calibrate sfm`: poses from images of whatever the cameras see.

use std::path::PathBuf;

use anyhow::Context;
use erfgs_calibrate::{
    board::not_metres,
    sfm::{CameraView, KnownIntrinsics, SfmOptions, read_views, sfm},
};
use erfgs_points::ColmapProgram;
use erfgs_scene::rig_file::RigFile;

use super::{steps::Steps, summary::finish};
use crate::terminal::Terminal;

/// Calibrate from images of whatever the cameras see, without a target (structure from motion by COLMAP).
#[derive(Debug, clap::Args)]
#[command(after_help = "\
INPUT is a dataset, a folder with one image of each camera, or a folder with a folder of images for each camera.

COLMAP reconstructs the cameras several times, with different features each time. A camera is accepted if independent runs \
agree on its pose. Others are placed by the points of the accepted ones, or left out, and named. If most cameras are in doubt \
there is no result. The accepted cameras are adjusted together with some thousand further points, found by matching with \
known poses.

--frame selects one of several images of a camera, in the order of the numbers in their names; the output names it. Features \
are searched at a size that this machine handles in some minutes; the output states it, and --feature-side overrides it.

Images have no scale: without --scale-from the unit of length is the root mean square distance of the cameras from their middle.

Examples:
  erfgs calibrate sfm images --rig intrinsics.json --scale-from left:right:1.25 --out rig.json
  erfgs calibrate sfm ds --known-intrinsics --frame 20
  erfgs calibrate sfm images --colmap pycolmap:venv/bin/python")]
pub struct Arguments {
    /// The images.
    input: PathBuf,
    /// A rig file whose intrinsics are kept. Default: intrinsics are estimated.
    #[arg(long, value_name = "RIG", conflicts_with = "known_intrinsics")]
    rig: Option<PathBuf>,
    /// Keep the dataset's intrinsics.
    #[arg(long)]
    known_intrinsics: bool,
    /// Which image of each camera, in the order of the numbers in their names, from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: usize,
    /// Two cameras and the distance of their centres in metres.
    #[arg(long, value_name = "A:B:METRES", value_parser = known_distance)]
    scale_from: Option<(String, String, f64)>,
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

fn known_distance(text: &str) -> Result<(String, String, f64), String> {
    let wrong = || format!("'{text}' is not two cameras and a distance in metres; write for example left:right:1.25");
    let [a, b, metres] = text.split(':').collect::<Vec<_>>()[..] else { return Err(wrong()) };
    let metres: f64 = metres.parse().map_err(|_| wrong())?;
    if a.is_empty() || b.is_empty() || a == b || !(metres > 0.0 && metres.is_finite()) {
        return Err(wrong());
    }
    // No two cameras of a rig are farther apart.
    match not_metres(metres, 500.0) {
        Some(meant) => Err(format!("'{text}': cameras {metres} m apart cannot be; {meant}")),
        None => Ok((a.into(), b.into(), metres)),
    }
}

/// Calibrates.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let rig = arguments.rig.as_deref().map(|path| RigFile::read(path).map(|rig| (rig, path))).transpose()?;
    let known = match &rig {
        Some((rig, path)) => KnownIntrinsics::Rig(rig, path),
        None if arguments.known_intrinsics => KnownIntrinsics::Dataset,
        None => KnownIntrinsics::Unknown,
    };
    let views = read_views(&arguments.input, arguments.frame, &known)?;
    tell_chosen(&views, arguments.frame, terminal);
    let mut options = SfmOptions {
        colmap: arguments.colmap.clone().unwrap_or_default(),
        scale: arguments.scale_from.clone(),
        threads: arguments.jobs.unwrap_or(0),
        ..SfmOptions::default()
    };
    if let Some(reduced) = options.afford(&views, arguments.feature_side) {
        terminal.note(reduced.to_string());
    }
    let work = erfgs_base::scratch::Scratch::new().context("cannot make a folder for intermediate files")?;
    let steps = Steps::new(terminal, Some(options.settings.len()));
    let (rig, evidence) = steps.during(|tell| sfm(&views, &options, work.path(), tell))?;
    finish(&rig, &evidence, &arguments.out, terminal)
}

/// Says which images were taken of cameras that have several.
fn tell_chosen(views: &[CameraView], frame: usize, terminal: &Terminal) {
    let mut names: Vec<(String, Vec<&str>)> = Vec::new();
    for view in views {
        let Some(name) = view.chosen.as_ref().and_then(|file| file.file_name()) else { continue };
        let name = name.to_string_lossy().into_owned();
        match names.iter_mut().find(|(known, _)| *known == name) {
            Some((_, cameras)) => cameras.push(&view.name),
            None => names.push((name, vec![&view.name])),
        }
    }
    for (name, cameras) in names {
        let cameras = match cameras[..] {
            [one] => one.to_owned(),
            [one, ref others @ ..] => format!("{one} and {} others", others.len()),
            [] => continue,
        };
        terminal.note(format!("image {frame} of {cameras} is {name}"));
    }
}
