//! `erfgs dataset import`: a recording in another tool's layout becomes a dataset.

use std::path::PathBuf;

use erfgs_dataset::import::{ImportOptions, Layout, import, session::SessionOptions};
use erfgs_scene::image::{Reading, Resample};

use super::session::{self, SessionArguments};
use crate::{info, parse::FrameRange, terminal::Terminal};

/// Make a dataset from a recording in another tool's layout.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Layouts:
  panoptic    PanopticSports: train_meta.json, test_meta.json, ims/, seg/
  neu3d       Neural 3D Video: cam00.mp4 ... (or folders of images) and poses_bounds.npy
  nvidia      Nvidia dynamic scenes, multi-view packaging: mv_images/ and poses_bounds.npy
  nerfstudio  transforms.json and what it names
  colmap      a COLMAP model and folders of images
  session     what erfgs record made (an MCAP file), and the calibrated rig (--rig rig.json)

Examples:
  erfgs dataset import session take1.mcap --rig rig.json --from 2.5 --seconds 1 --scale 0.5 --out ds
  erfgs dataset import panoptic basketball --frames 40..84 --scale 0.5 --out ds
  erfgs dataset import neu3d flame_steak --frames 0..299 --scale 0.5 --out ds
  erfgs dataset import nerfstudio lego --background white --out ds
  erfgs dataset import colmap scene --test cam00,cam07 --fps 60 --out ds")]
pub struct Arguments {
    /// How the recording is laid out.
    layout: LayoutName,
    /// The folder of the recording, or the session.
    #[arg(value_name = "DIR|S.mcap")]
    source: PathBuf,
    /// The folder of the new dataset.
    #[arg(long, value_name = "DATASET")]
    out: PathBuf,
    /// First and last frame, both included; numbered as in the source's file names (panoptic), else from 0.
    #[arg(long, value_name = "FIRST..LAST")]
    frames: Option<FrameRange>,
    /// Size of the imported images as a fraction of the source's.
    #[arg(long, value_name = "FACTOR", value_parser = scale)]
    scale: Option<f64>,
    /// How images are resized.
    #[arg(long, value_enum, default_value_t = ResampleName::Area)]
    resample: ResampleName,
    /// Frames a second, where the source (videos, `time` of transforms.json) does not say or is wrong.
    #[arg(long, value_name = "FPS")]
    fps: Option<f64>,
    /// Background colour of transparent pixels: black, white or #rrggbb. By default images with such pixels are refused.
    #[arg(long, value_name = "COLOUR", value_parser = colour)]
    background: Option<[u8; 3]>,
    /// Number of significant low bits in 16-bit samples, 8 to 16, of images and of frames in AEDAT 4. Default: all, and
    /// images that would be nearly black are refused.
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u8).range(8..=16))]
    bits: Option<u8>,
    /// Names of the held-out cameras, separated by commas. Default: the layout's own choice.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    test: Option<Vec<String>>,
    /// Number of threads. Default: one for each core.
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    #[command(flatten)]
    session: SessionArguments,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum LayoutName {
    Panoptic,
    Neu3d,
    Nvidia,
    Nerfstudio,
    Colmap,
    Session,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum ResampleName {
    /// Mean over the area of a new pixel.
    Area,
    /// Windowed sinc with three lobes.
    Lanczos,
}

impl LayoutName {
    /// As another tool's layout; `None` for a session, which is erfgs's own.
    fn of_others(self) -> Option<Layout> {
        match self {
            Self::Panoptic => Some(Layout::Panoptic),
            Self::Neu3d => Some(Layout::Neu3d),
            Self::Nvidia => Some(Layout::Nvidia),
            Self::Nerfstudio => Some(Layout::Nerfstudio),
            Self::Colmap => Some(Layout::Colmap),
            Self::Session => None,
        }
    }
}

pub fn scale(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(scale) if scale > 0.0 && scale <= 16.0 => Ok(scale),
        _ => Err("a factor above 0 and at most 16 is needed, for example 0.5".into()),
    }
}

/// `black`, `white` or `#rrggbb`.
fn colour(text: &str) -> Result<[u8; 3], String> {
    let digits = match text {
        "black" => "000000",
        "white" => "ffffff",
        _ => text.strip_prefix('#').unwrap_or_default(),
    };
    let value = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6 && digits.is_ascii());
    let [_, r, g, b] = value.ok_or("a colour is needed: black, white or #rrggbb")?.to_be_bytes();
    Ok([r, g, b])
}

/// Imports and says what came of it.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let resample = match arguments.resample {
        ResampleName::Area => Resample::Area,
        ResampleName::Lanczos => Resample::Lanczos,
    };
    let test_cameras = arguments.test.clone();
    let Some(layout) = arguments.layout.of_others() else {
        anyhow::ensure!(
            arguments.frames.is_none() && arguments.fps.is_none(),
            "a session has its own frame times: use --from, --seconds and --every instead of --frames and --fps"
        );
        anyhow::ensure!(
            arguments.background.is_none(),
            "frames of a session are not transparent: --background is for images of other layouts"
        );
        let scale = arguments.scale.unwrap_or(1.0);
        let options = SessionOptions {
            scale,
            resample,
            test_cameras,
            bits: arguments.bits,
            jobs: arguments.jobs,
            ..SessionOptions::default()
        };
        let (dataset, faults) = session::run(&arguments.source, &arguments.out, options, &arguments.session, terminal)?;
        info::dataset(&dataset, terminal)?;
        return faults;
    };
    anyhow::ensure!(
        arguments.session.rig.is_none(),
        "--rig goes with the layout session; {:?} has poses of its own",
        layout
    );
    let options = ImportOptions {
        frames: arguments.frames.map(|range| (range.first, range.last)),
        scale: arguments.scale,
        resample,
        fps: arguments.fps,
        reading: Reading { background: arguments.background, bits: arguments.bits },
        test_cameras,
        jobs: arguments.jobs,
    };
    let progress = terminal.progress("importing");
    let imported = import(layout, &arguments.source, &options, &arguments.out, &mut |step| {
        progress.update(step.done, step.total, step.what);
    })?;
    drop(progress);
    for note in &imported.notes {
        terminal.note(note);
    }
    info::dataset(&imported.dataset, terminal)
}
