//! `erfgs render`: pictures and videos of a run.

mod path;

use std::path::{Path, PathBuf};

use anyhow::Context;
use erfgs_base::{
    FileError,
    atomic::{Together, numbered},
};
use erfgs_dataset::Manifest;
use erfgs_run::RunFolder;
use erfgs_scene::{
    ImageRgb8, Intrinsics,
    exr::{Layers, write_layers},
    video::VideoWriter,
};
use erfgs_splat::{gpu::Gpu, model::Rendered, raster::View, trained::TrainedScene};
use serde::Serialize;

use self::path::Choice;
use crate::{
    device::TrainedRun,
    errors::{Usage, not_over, not_over_pictures},
    takes::{self, OpenTake},
    terminal::{Terminal, table},
};

/// Render a run.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Paths:
  orbit        a full turn about what the cameras look at
  camera NAME  a camera of the dataset, standing still while the scene moves
  FILE         a JSON file of poses, interpolated to the number of frames:
               {\"intrinsics\": {...} (optional, as in dataset.json),
                \"world_to_camera\": [{\"rotation_wxyz\": [1, 0, 0, 0], \"translation_m\": [0, 0, 0]}, ...],
                \"times_s\": [0.2, ...] (optional: when the camera is there; not with --times)}
               `erfgs view` writes such a file (More, Save path)

Formats:
  png  8 bits, display-referred
  exr  linear colour R, G, B, opacity A, depth Z in metres along the optical axis
  mp4  H.264, by ffmpeg

Examples:
  erfgs render run --path orbit --out orbit.mp4
  erfgs render run --path camera 10 --times 0.4..0.9 --frames 200 --out slow.mp4
  erfgs render run --path keys.json --times 0.5 --format exr --out frozen
  erfgs render sweep --take dance-s0 --path keys.json --out dance.mp4")]
pub struct Arguments {
    #[command(flatten)]
    run: TrainedRun,
    /// Which take, where the run is the folder of a sweep that has several: its windows are rendered one after another.
    #[arg(long, value_name = "NAME")]
    take: Option<String>,
    /// Where the camera goes: orbit, camera NAME, or a file.
    #[arg(long, num_args = 1..=2, value_names = ["orbit|camera|FILE", "NAME"], default_value = "orbit")]
    path: Vec<String>,
    /// Time range of the recording, seconds from its start; a single instant freezes the scene. Default: all of it.
    #[arg(long, value_name = "FROM..TO")]
    times: Option<Times>,
    /// Number of frames. Default: the rendered time at --fps.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
    /// Frames a second of the video.
    #[arg(long, default_value_t = 30.0, value_parser = rate)]
    fps: f64,
    /// Size of the pictures as a fraction of the camera's.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = scale)]
    scale: f64,
    /// Output format. Default: by the extension of --out, else png.
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// A folder for pictures, or an .mp4 file.
    #[arg(long, value_name = "FOLDER|FILE.mp4")]
    out: PathBuf,
    /// Overwrite existing files. Pictures of an earlier film in the folder go when the new ones are whole.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Format {
    Png,
    Exr,
    Mp4,
}

/// Digits of the number that is the name of a picture.
const DIGITS: usize = 5;

impl Format {
    /// The extension of pictures.
    fn pictures(self) -> Option<&'static str> {
        match self {
            Self::Png => Some("png"),
            Self::Exr => Some("exr"),
            Self::Mp4 => None,
        }
    }
}

/// Seconds from the start of the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Times {
    from: f64,
    to: f64,
}

impl std::str::FromStr for Times {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (from, to) = text.split_once("..").unwrap_or((text, text));
        let second = |part: &str| part.trim().parse::<f64>().ok().filter(|second| second.is_finite() && *second >= 0.0);
        second(from)
            .zip(second(to))
            .filter(|(from, to)| from <= to)
            .map(|(from, to)| Self { from, to })
            .ok_or_else(|| format!("'{text}' is no time or range of times in seconds; write 0.5 or 0.2..1.4"))
    }
}

fn rate(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|fps| (0.1..=1000.0).contains(fps)).ok_or("a rate from 0.1 to 1000 is needed".into())
}

fn scale(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|scale| (0.01..=16.0).contains(scale)).ok_or("a factor from 0.01 to 16 is needed".into())
}

#[derive(Serialize)]
struct Summary<'a> {
    out: &'a Path,
    format: Format,
    frames: usize,
    width: u32,
    height: u32,
    render_fps: f64,
}

/// Renders and says what was written.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let choice = Choice::from_words(&arguments.path)?;
    let is_video = arguments.out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mp4"));
    let format = arguments.format.unwrap_or(if is_video { Format::Mp4 } else { Format::Png });
    if is_video != (format == Format::Mp4) {
        return Err(Usage("MP4 goes to a file that ends in .mp4, PNG and EXR go to a folder".into()).into());
    }
    match format.pictures() {
        Some(extension) => not_over_pictures(&arguments.out, DIGITS, extension, arguments.force)?,
        None => not_over(&arguments.out, arguments.force)?,
    }
    let gpu = arguments.run.device()?;
    let mut subject = Subject::open(arguments, &gpu, terminal)?;
    let span = subject.seconds();
    let times = arguments.times.unwrap_or(Times { from: 0.0, to: span });
    // Seconds are told to the millisecond; what is beyond by rounding is the end.
    if times.to > span + 1e-3 {
        return Err(Usage(format!("--times ends at {} s, but the recording is {span:.3} s long", times.to)).into());
    }
    let still = times.to == times.from;
    let frames = arguments.frames.map_or_else(
        || match (still, &choice) {
            (true, Choice::Camera(_)) => 1,
            // A full turn round a frozen scene takes four seconds.
            (true, _) => (4.0 * arguments.fps) as usize,
            (false, _) => ((times.to - times.from) * arguments.fps).round() as usize + 1,
        },
        |frames| frames as usize,
    );
    let stations = choice.stations(&subject.recording()?, frames)?;
    if arguments.times.is_some() && stations.iter().any(|station| station.time_s.is_some()) {
        return Err(Usage("the path has times of its own: leave --times out".into()).into());
    }
    let size = resized(&stations[0].intrinsics, arguments.scale);
    let mut writer = Writer::create(&arguments.out, format, size.width, size.height, arguments.fps)?;
    let progress = terminal.progress("rendering");
    let mut seconds = 0.0;
    for (index, station) in stations.iter().enumerate() {
        progress.update(index as u64, frames as u64, "frames");
        let along = index as f64 / (frames.max(2) - 1) as f64;
        let time_s = station.time_s.unwrap_or(times.from + along * (times.to - times.from));
        let view = View::try_from((&resized(&station.intrinsics, arguments.scale), &station.world_to_camera))?;
        let (scene, t01) = subject.at(time_s)?;
        let started = std::time::Instant::now();
        let rendered = scene.render(&view, t01).context("cannot render")?;
        seconds += started.elapsed().as_secs_f64();
        writer.push(index, &view, &rendered)?;
    }
    writer.finish()?;
    drop(progress);
    let summary = Summary {
        out: &arguments.out,
        format,
        frames,
        width: size.width,
        height: size.height,
        render_fps: frames as f64 / seconds.max(1e-9),
    };
    terminal.result(&summary, || {
        table(&[
            vec!["written".into(), summary.out.display().to_string()],
            vec!["frames".into(), format!("{} of {} x {}", summary.frames, summary.width, summary.height)],
            vec!["rendering".into(), format!("{:.1} frames a second", summary.render_fps)],
        ])
    })
}

fn resized(intrinsics: &Intrinsics, scale: f64) -> Intrinsics {
    let pixels = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
    intrinsics.resized(pixels(intrinsics.width), pixels(intrinsics.height))
}

/// What is rendered.
enum Subject<'a> {
    Run(RunFolder, Box<TrainedScene<'a>>),
    /// The windows of a long take, one after another.
    Take(Box<OpenTake<'a>>),
}

impl<'a> Subject<'a> {
    fn open(arguments: &Arguments, gpu: &'a Gpu, terminal: &Terminal) -> anyhow::Result<Self> {
        let run = &arguments.run;
        if let Some(windows) = takes::windows(&run.run, arguments.take.as_deref(), run.adapter(), terminal)? {
            return Ok(Self::Take(Box::new(OpenTake::new(gpu, windows))));
        }
        let folder = run.folder()?;
        let scene = run.scene(gpu, &folder)?;
        Ok(Self::Run(folder, Box::new(scene)))
    }

    /// How long it is.
    fn seconds(&self) -> f64 {
        match self {
            Self::Run(_, scene) => scene.record().seconds(),
            Self::Take(take) => take.seconds(),
        }
    }

    /// Where its cameras stand: those of a take stand in all of its windows where they do in the first.
    fn recording(&self) -> anyhow::Result<Manifest> {
        let folder = match self {
            Self::Run(folder, _) => folder,
            Self::Take(take) => &take.first().context("the take has no windows")?.folder,
        };
        Ok(folder.read_dataset()?)
    }

    /// What shows an instant, seconds from the beginning, and when that is for it, in [0, 1].
    fn at(&mut self, seconds: f64) -> anyhow::Result<(&mut TrainedScene<'a>, f64)> {
        match self {
            Self::Run(_, scene) => {
                let t01 = scene.record().share(seconds);
                Ok((scene, t01))
            }
            Self::Take(take) => take.at(seconds),
        }
    }
}

/// Where the pictures go.
enum Writer<'a> {
    Pictures { format: Format, out: &'a Path, folder: Together },
    Mp4(VideoWriter),
}

impl<'a> Writer<'a> {
    fn create(out: &'a Path, format: Format, width: u32, height: u32, fps: f64) -> anyhow::Result<Self> {
        if format == Format::Mp4 {
            return Ok(Self::Mp4(VideoWriter::create(out, width, height, fps)?));
        }
        let folder = Together::begin(out).map_err(FileError::when("make the folder", out))?;
        Ok(Self::Pictures { format, out, folder })
    }

    fn push(&mut self, index: usize, view: &View, rendered: &Rendered) -> anyhow::Result<()> {
        let (width, height) = (view.width, view.height);
        match self {
            Self::Pictures { format: Format::Exr, folder, .. } => {
                let Rendered { rgb, transmittance, depth } = rendered;
                let layers = Layers { width, height, rgb, transmittance, depth };
                Ok(write_layers(&folder.path().join(format!("{index:0DIGITS$}.exr")), &layers)?)
            }
            Self::Pictures { folder, .. } => {
                let image = ImageRgb8 { width, height, data: rendered.to_bytes() };
                Ok(image.write_png(&folder.path().join(format!("{index:0DIGITS$}.png")))?)
            }
            Self::Mp4(video) => Ok(video.push(&rendered.to_bytes())?),
        }
    }

    fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Pictures { format, out, folder } => {
                let is_picture = numbered(DIGITS, format.pictures().unwrap_or_default());
                Ok(folder.finish(is_picture).map_err(FileError::when("write", out))?)
            }
            Self::Mp4(video) => Ok(video.finish()?),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_an_instant_or_a_range_of_seconds() {
        assert_eq!("0.5".parse(), Ok(Times { from: 0.5, to: 0.5 }));
        assert_eq!("0.2..1.4".parse(), Ok(Times { from: 0.2, to: 1.4 }));
        for wrong in ["", "a", "1..0", "-1..2", "nan", "0..inf"] {
            assert!(wrong.parse::<Times>().is_err(), "{wrong}");
        }
    }
}
