//! `erfgs export`: runs, datasets, sessions and event files in the formats of other programs.

mod biases;
mod bridge;
mod dataset;
mod event_video;
mod events;
mod excerpt;
mod format;
mod frames;
mod motion;
mod run;
mod scene;

use std::path::{Path, PathBuf};

use erfgs_base::names::FileNames;
use erfgs_dataset::Dataset;
use erfgs_session::{
    container::{self, Recording, Summary},
    export::{FramesFormat, PICTURE_DIGITS},
    source::Encoding,
};

pub use self::format::events_format;
use self::{
    event_video::Pictures,
    format::{Format, Kind, STREAM_FORMATS, To, to},
    scene::SceneOptions,
};
use crate::{
    device::{Adapter, TrainedRun},
    errors::{Usage, not_over, not_over_pictures},
    event_file::EventFileOptions,
    takes,
    terminal::Terminal,
};

/// Write the Gaussians of a run, a dataset, or the streams of a session or an event file, in the formats of other programs.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A run gives PLY files with the standard layout of 3D Gaussian splatting, which viewers read: point_cloud.ply holds the \
canonical Gaussians; point_cloud_t/00000.ply and so on hold them as they stand at instants spread over the recording. With
  html  one page to share, which opens from a disk in a browser with WebGPU: `erfgs view` without a program
  e4d   the scene of such a page alone, packed, for `erfgs view` (docs/reference/scene-file.md describes it)
  4dgs  the open container of 4D Gaussians, for its readers in several languages (https://4dgs.dev)
  gltf  one instant (--at) as binary glTF with Khronos' KHR_gaussian_splatting, for engines and editors
  spz   one instant (--at) in Niantic's packed format, a fifth as large, for viewers in browsers
  motion  a table (CSV) of how its bodies move: places, velocities, rotations and rates, at --instants

A dataset gives its frames, cameras and initial points as other trainers read them; frames.csv has the times and the split:
  colmap      images/ and a model in sparse/0, as 3DGS and most trainers after it read them
  nerfstudio  images/ and transforms.json, with times from 0 to 1 and the initial points

A session, a recording of ROS 2 or an event file gives its event streams as
  raw  the words of a Prophesee sensor as they came, with the header that Metavision looks for; all else encoded as EVT 3 or 2
  dat  DAT, version 2
  aedat4  events, edges, frames and inertial samples, as DV reads them
  csv  lines of t, x, y, on
  npz  NumPy arrays t, x, y, p
  h5   HDF5 in the layout of the DSEC data set (if erfgs was built with --features hdf5)
and the frames of its cameras, and of event sensors that have frames, as
  png  one file for each frame, and their times in frames.csv; of 16 bits where the camera gave more than 8
  exr  the same in linear light; of Bayer and deep grey frames all that the sensor gave
  mp4  a video for each camera (ffmpeg), at its mean rate; of the events of an event camera, brighter and darker, at --fps, \
--speed and --accumulate (of one that has frames, too, its events are shown over them where --accumulate is given)
  session  a recording of its own, byte for byte, with the streams' settings and the rig: what --from and --until leave of it
or all of it on its one clock (fitted now, where `erfgs sync` has not) for the tools of others, with lenses and poses where --rig is given:
  foxglove  an MCAP file for Foxglove and Rerun: pictures of the frames, and of the events at --fps and --accumulate
  rosbag2   a folder with a bag of ROS 2: the events as EVT 3, the frames as the cameras gave them
or of each EVK4 what it was recorded with, as
  bias  a bias file of Metavision, which `bias_file` in RIG.toml reads, too
All streams that fit the format are written, or the one named with --stream. --from and --until select data by their time of \
arrival. Packets are kept whole, so that some milliseconds before the range may be included. Existing files \
are overwritten only with --force.

Exit codes: 0 exported, 1 the recording is cut off or damaged (all else was exported), 2 wrong usage.

Examples:
  erfgs export run --instants 10 --out splats
  erfgs export run --to html --out throw.html
  erfgs export sweep --to html --out take.html
  erfgs export run --to e4d --out throw.e4d
  erfgs export run --to gltf --at 0.35 --out throw.glb
  erfgs export run --to spz --at 0.35 --out throw.spz
  erfgs export run --to motion --out throw.csv
  erfgs export ds --to colmap --out ds-colmap
  erfgs export S.mcap --to raw --stream ev0 --out ev0.raw
  erfgs export S.mcap --to mp4 --out videos
  erfgs export S.mcap --to session --from 12.5 --until 14 --out throw.mcap
  erfgs export S.mcap --to foxglove --rig rig.json --out take.foxglove.mcap
  erfgs export S.mcap --to rosbag2 --rig rig.json --out take-bag
  erfgs export S.mcap --to mp4 --stream ev0 --from 12.9 --until 13.1 --speed 0.02 --out slow.mp4
  erfgs export S.mcap --to bias --stream ev0 --out quiet.bias
  erfgs export davis346.aedat4 --to png --out frames
  erfgs export recording.raw --to csv --out events.csv")]
pub struct Arguments {
    /// A run folder, the folder of a sweep with windows of a take, a dataset, a session, an MCAP recording of ROS 2, or an event file: RAW, DAT, AEDAT, Event Stream, text, NPZ, NPY, HDF5, rosbag2.
    #[arg(value_name = "RUN|DATASET|S.mcap|FILE")]
    input: PathBuf,
    /// The dataset, where it is no longer where the run was trained on it.
    #[arg(long, value_name = "DATASET", help_heading = "Of a run")]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    adapter: Adapter,
    /// Number of instants, spread from the first to the last of the recording. Default: as many as the held-out cameras
    /// have; of motion 250 a second, up to 2001.
    #[arg(long, value_name = "N", help_heading = "Of a run")]
    instants: Option<u32>,
    /// The format.
    #[arg(long, value_name = "FORMAT", value_parser = to, help_heading = "Of a run, a dataset, a session or an event file")]
    to: Option<To>,
    /// Which take, where the input is the folder of a sweep that has several: its windows become one page (html).
    #[arg(long, value_name = "NAME", help_heading = "Of a run")]
    take: Option<String>,
    /// Keep all numbers to the bit, in a file five times as large (html, e4d).
    #[arg(long, help_heading = "Of a run")]
    exact: bool,
    /// The instant that gltf and spz show, seconds from the start of the recording. Default: the middle.
    #[arg(long, value_name = "SECONDS", value_parser = crate::parse::seconds, help_heading = "Of a run")]
    at: Option<f64>,
    /// One stream, by its name in `erfgs info`.
    #[arg(long, value_name = "ID", help_heading = "Of a session or an event file")]
    stream: Option<String>,
    #[command(flatten, next_help_heading = "Of a session or an event file")]
    file_is: EventFileOptions,
    /// Number of significant low bits in the 16-bit samples of an AEDAT 4 file, 8 to 16. Default: all, and frames that would
    /// be nearly black are refused (png, exr, mp4).
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u8).range(8..=16), help_heading = "Of a session or an event file")]
    bits: Option<u8>,
    /// Leave out what arrived before this second of the recording.
    #[arg(long, value_name = "SECONDS", value_parser = crate::parse::seconds, help_heading = "Of a session or an event file")]
    from: Option<f64>,
    /// Leave out what arrived after this second of the recording.
    #[arg(long, value_name = "SECONDS", value_parser = crate::parse::seconds, help_heading = "Of a session or an event file")]
    until: Option<f64>,
    #[command(flatten)]
    video: event_video::VideoOptions,
    #[command(flatten)]
    bridge: bridge::BridgeOptions,
    /// Overwrite existing files. Numbered pictures and point clouds of an earlier export go when the new ones are whole.
    #[arg(long, help_heading = "Of a run, a session or an event file")]
    force: bool,
    /// The folder to write to, or the file, with --stream or if the input is an event file. Default: beside the input.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

/// Looks at what the path is, and exports it.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let input = &arguments.input;
    if !input.exists() {
        return Err(Usage(format!("'{}' does not exist", input.display())).into());
    }
    let input = &*container::recording_file(input)?;
    let manifest = input.file_name().is_some_and(|name| name == Dataset::MANIFEST);
    arguments.suit(input, input.is_file() && !manifest)?;
    match (input.is_file() && !manifest, arguments.to) {
        (true, Some(To::Streams(format))) => recording(input, format, arguments, terminal),
        (true, Some(To::Scene(_) | To::Motion)) => {
            Err(Usage(format!("'{}' is no run; give the folder that `erfgs train --out` wrote", input.display())).into())
        }
        (false, Some(To::Scene(format))) => {
            let of_run = TrainedRun::new(input, arguments.dataset.as_deref(), &arguments.adapter);
            let &Arguments { force, exact, at, .. } = arguments;
            let options = SceneOptions { format, out: arguments.out.as_deref(), force, exact, at };
            match takes::windows(input, arguments.take.as_deref(), &arguments.adapter, terminal)? {
                Some(windows) => {
                    let file = arguments.out.clone().unwrap_or_else(|| takes::page_file(input, &windows));
                    scene::take(&windows, &file, options, &arguments.adapter, terminal)
                }
                None => scene::run(&of_run, options, terminal),
            }
        }
        (false, Some(To::Motion)) => {
            let of_run = TrainedRun::new(input, arguments.dataset.as_deref(), &arguments.adapter);
            motion::run(&of_run, arguments.instants, arguments.out.as_deref(), arguments.force, terminal)
        }
        (true, Some(To::Dataset(_))) => Err(Usage(format!(
            "'{}' is no dataset; make one with `erfgs dataset import session`, or export the recording to another format",
            input.display()
        ))
        .into()),
        (true, None) => {
            Err(Usage(format!("choose the format of the export: --to {STREAM_FORMATS}")).into())
        }
        (false, Some(To::Dataset(layout))) => {
            let Some(out) = &arguments.out else {
                return Err(Usage("give --out FOLDER, which must be empty or new".into()).into());
            };
            dataset::run(input, layout, out, terminal)
        }
        (false, Some(To::Streams(_))) => Err(Usage(format!(
            "'{}' is a folder; a dataset is exported --to colmap or nerfstudio, and the Gaussians of a run without --to",
            input.display()
        ))
        .into()),
        (false, None) => {
            let of_run = TrainedRun::new(input, arguments.dataset.as_deref(), &arguments.adapter);
            run::run(&of_run, arguments.instants, arguments.out.as_deref(), arguments.force, terminal)
        }
    }
}

impl Arguments {
    /// Refuses options that say nothing of what is exported.
    fn suit(&self, input: &Path, is_recording: bool) -> Result<(), Usage> {
        let (is_scene, is_dataset) = (matches!(self.to, Some(To::Scene(_))), matches!(self.to, Some(To::Dataset(_))));
        let is_run = !is_recording && !is_dataset;
        let hints = self.file_is.hints();
        let given = [
            ("--stream", self.stream.is_some(), is_recording, "a session or an event file"),
            ("--size", hints.size.is_some(), is_recording, "an event file"),
            ("--columns", hints.columns.is_some(), is_recording, "an event file"),
            ("--bits", self.bits.is_some(), is_recording, "a session or an event file"),
            ("--from", self.from.is_some(), is_recording, "a session or an event file"),
            ("--until", self.until.is_some(), is_recording, "a session or an event file"),
            ("--dataset", self.dataset.is_some(), is_run, "a run"),
            ("--instants", self.instants.is_some(), is_run && !is_scene, "a run without --to, or --to motion"),
            ("--take", self.take.is_some(), is_run && is_scene, "a sweep (--to html)"),
            ("--exact", self.exact, is_run && is_scene, "a run (--to html or e4d)"),
            ("--at", self.at.is_some(), is_run && is_scene, "a run (--to gltf or spz)"),
        ];
        if let Some((name, _, _, of)) = given.into_iter().find(|(_, is_given, fits, _)| *is_given && !fits) {
            return Err(Usage(format!("{name} is for {of}, and nothing of '{}' is exported by it", input.display())));
        }
        if is_recording {
            return Ok(());
        }
        self.bridge.fits(Kind::Session)?;
        self.video.fits(Pictures::None)
    }
}

/// An error if the recording is cut or damaged, of which everything else was exported.
fn complain(recording: &Recording, lost: &[String]) -> anyhow::Result<()> {
    complain_of("exported", recording.path(), recording.summary(), lost)
}

/// An error if a recording is cut or damaged, with which all else was done. `lost` is what was found meanwhile.
pub fn complain_of(done: &str, path: &Path, summary: &Summary, lost: &[String]) -> anyhow::Result<()> {
    let mut faults = summary.faults();
    faults.extend(lost.iter().filter(|lost| !summary.damage.contains(lost)).cloned());
    complain_of_damage(done, path, &faults)
}

/// An error if there are faults in a recording with which all else was done.
pub fn complain_of_damage(done: &str, path: &Path, faults: &[String]) -> anyhow::Result<()> {
    let Some(first) = faults.first() else { return Ok(()) };
    let others = if faults.len() > 1 { format!(" (and {} faults more)", faults.len() - 1) } else { String::new() };
    anyhow::bail!("the intact part was {done}; {} has faults: {first}{others}", path.display())
}

/// One stream and where it goes.
struct Task {
    stream: usize,
    id: String,
    out: PathBuf,
}

fn recording(path: &Path, format: Format, arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut recording = Recording::open_with(path, &arguments.file_is.hints())?;
    let range = range(&recording, arguments)?;
    arguments.bridge.fits(format.kind())?;
    if let Kind::Bridge(tool) = format.kind() {
        return bridge::export(recording, tool, range, arguments, terminal);
    }
    if matches!(format.kind(), Kind::Session) {
        return excerpt::export(&mut recording, range, arguments, terminal);
    }
    arguments.video.fits(format.pictures())?;
    let tasks = tasks(&recording, format, arguments)?;
    for task in &tasks {
        not_input(&task.out, path)?;
    }
    for file in tasks.iter().flat_map(|task| format.writes(&task.out)) {
        not_over(&file, arguments.force)?;
    }
    if format.is_folder() {
        for task in &tasks {
            not_over_pictures(&task.out, PICTURE_DIGITS, format.extension(), arguments.force)?;
        }
    }
    recording.restrict(range);
    let mut lost = Vec::new();
    let exports = match format.kind() {
        Kind::Events(format) => return events::export(&mut recording, format, &tasks, terminal),
        Kind::Frames(format) => frames::export(&mut recording, (format, arguments.bits), &tasks, &mut lost, terminal)?,
        Kind::Biases => return biases::export(&recording, &tasks, terminal),
        Kind::Video | Kind::Session | Kind::Bridge(_) => {
            let encoding = |task: &Task| recording.summary().streams[task.stream].description.encoding;
            let (of_events, of_frames): (Vec<_>, Vec<_>) =
                tasks.into_iter().partition(|task| arguments.video.shows_events_of(encoding(task)));
            let mut exports = event_video::export(&mut recording, &arguments.video, &of_events, &mut lost, terminal)?;
            exports.extend(frames::export(
                &mut recording,
                (FramesFormat::Mp4, arguments.bits),
                &of_frames,
                &mut lost,
                terminal,
            )?);
            exports
        }
    };
    // A camera that made no pictures is no failure, unless there is nothing else.
    if exports.iter().all(|exports| exports.is_empty) {
        anyhow::bail!("{} has no frames", recording.path().display());
    }
    let exported: Vec<&serde_json::Value> = exports.iter().map(|exports| &exports.exported).collect();
    terminal
        .result(&exported, || exports.iter().map(|exports| exports.line.as_str()).collect::<Vec<_>>().join("\n"))?;
    complain(&recording, &lost)
}

/// Refuses to write over the input.
fn not_input(out: &Path, input: &Path) -> Result<(), Usage> {
    if std::fs::canonicalize(out).ok().is_some_and(|out| std::fs::canonicalize(input).ok() == Some(out)) {
        return Err(Usage(format!("'{}' is the input itself; give another --out", out.display())));
    }
    Ok(())
}

/// What is exports of a stream that became pictures.
struct StreamExport {
    exported: serde_json::Value,
    /// Whether it had none.
    is_empty: bool,
    line: String,
}

/// What `--from` and `--until` leave, session nanoseconds.
fn range(recording: &Recording, arguments: &Arguments) -> anyhow::Result<Option<[i64; 2]>> {
    let (from, until) = (arguments.from, arguments.until);
    if from.is_none() && until.is_none() {
        return Ok(None);
    }
    let summary = recording.summary();
    let length_ns = summary.span_ns().map_or(0, |[_, last]| summary.start.session_ns(last));
    let window = [from.map_or(0, |from| (from * 1e9) as i64), until.map_or(length_ns, |until| (until * 1e9) as i64)];
    let seconds = length_ns as f64 * 1e-9;
    if window[0] > length_ns {
        let path = recording.path().display();
        return Err(
            Usage(format!("--from {} is behind the end: {path} is {seconds:.3} s long", from.unwrap_or(0.0))).into()
        );
    }
    if window[0] >= window[1] {
        return Err(Usage("--until must be later than --from".into()).into());
    }
    Ok(Some(window))
}

fn tasks(recording: &Recording, format: Format, arguments: &Arguments) -> anyhow::Result<Vec<Task>> {
    let path = recording.path();
    let fits = |encoding: Encoding| match format.kind() {
        Kind::Events(format) => format.fits(encoding),
        Kind::Frames(_) => encoding.is_frames() || encoding.has_sensor_frames(),
        Kind::Video => encoding.is_frames() || encoding.is_events(),
        Kind::Biases => encoding.is_events(),
        Kind::Session | Kind::Bridge(_) => true,
    };
    let extension = format.extension();
    let streams = &recording.summary().streams;
    let chosen: Vec<usize> = match &arguments.stream {
        Some(id) => {
            let (stream, found) = recording.stream(id)?;
            if !fits(found.description.encoding) {
                let encoding = found.description.encoding;
                return Err(
                    Usage(format!("stream '{id}' is {encoding}, which cannot be written as {extension}")).into()
                );
            }
            vec![stream]
        }
        None => (0..streams.len()).filter(|&stream| fits(streams[stream].description.encoding)).collect(),
    };
    if chosen.is_empty() {
        let are: Vec<&str> = streams.iter().map(|stream| stream.description.encoding.name()).collect();
        let are = if are.is_empty() { String::new() } else { format!(": they are {}", are.join(", ")) };
        return Err(Usage(format!("{} has no stream that can be written as {extension}{are}", path.display())).into());
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let is_event_file = matches!(recording, Recording::EventFile(_));
    let mut names = FileNames::default();
    let task = |stream: usize| {
        let id = streams[stream].description.id.clone();
        let name = names.give(&id);
        let name = if format.is_folder() { name } else { format!("{name}.{extension}") };
        let out = match &arguments.out {
            Some(out) if arguments.stream.is_some() => out.clone(),
            Some(out) if is_event_file && (format.is_folder() || !out.is_dir()) => out.clone(),
            Some(folder) => folder.join(name),
            None if is_event_file && format.is_folder() => path.with_extension("frames"),
            None if is_event_file => path.with_extension(extension),
            None => path.with_file_name(format!("{stem}.{name}")),
        };
        Task { stream, id, out }
    };
    Ok(chosen.into_iter().map(task).collect())
}
