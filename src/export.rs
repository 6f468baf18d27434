//! `erfgs export`: runs and sessions in the formats of other programs.

mod events;
mod frames;
mod run;

use std::path::{Path, PathBuf};

use erfgs_session::container::Session;

use crate::{device::TrainedRun, errors::Usage, terminal::Terminal};

/// Write the Gaussians of a run, or the streams of a session, in the formats of other programs.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A run gives PLY files with the standard layout of 3D Gaussian splatting, which viewers read: point_cloud.ply holds the \
canonical Gaussians; point_cloud_t/00000.ply and so on hold them as they stand at instants spread over the recording.

A session gives its event streams as
  raw  the words of a Prophesee sensor as they came, with the header that Metavision looks for
  aedat4  events, edges, frames and inertial samples, as DV reads them
  csv  lines of t, x, y, on
  npz  NumPy arrays t, x, y, p
  h5   HDF5 in the layout of the DSEC data set (if erfgs was built with --features hdf5)
and the frames of its cameras as
  png  one file for each frame, and their times in frames.csv; of 16 bits where the camera gave more than 8
  exr  the same in linear light; of Bayer and deep grey frames all that the sensor gave
  mp4  a video for each camera (ffmpeg), at its mean rate
All streams that fit the format are written, or the one named with --stream.

Examples:
  erfgs export run --instants 10 --out splats
  erfgs export S.mcap --to raw --stream ev0 --out ev0.raw
  erfgs export S.mcap --to mp4 --out videos")]
pub struct Arguments {
    #[command(flatten)]
    run: TrainedRun,
    /// At how many instants, from the first to the last of the recording; as many as the held-out cameras have without it.
    #[arg(long, value_name = "N", help_heading = "Of a run")]
    instants: Option<u32>,
    /// The format.
    #[arg(long, value_enum, help_heading = "Of a session")]
    to: Option<Format>,
    /// One stream, by its name in `erfgs info`.
    #[arg(long, value_name = "ID", help_heading = "Of a session")]
    stream: Option<String>,
    /// The folder to write to, or the file if --stream makes it one; beside the input without it.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

/// What a session is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Raw,
    Aedat4,
    Csv,
    Npz,
    H5,
    Png,
    Exr,
    Mp4,
}

impl Format {
    fn extension(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Aedat4 => "aedat4",
            Self::Csv => "csv",
            Self::Npz => "npz",
            Self::H5 => "h5",
            Self::Png => "png",
            Self::Exr => "exr",
            Self::Mp4 => "mp4",
        }
    }

    fn is_of_events(self) -> bool {
        matches!(self, Self::Raw | Self::Aedat4 | Self::Csv | Self::Npz | Self::H5)
    }

    /// Whether a stream becomes a folder.
    fn is_folder(self) -> bool {
        matches!(self, Self::Png | Self::Exr)
    }
}

/// Looks at what the path is, and exports it.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let path = &arguments.run.run;
    let is_session = path.is_file() && path.extension().is_some_and(|extension| extension == "mcap");
    match (is_session, arguments.to) {
        (true, Some(format)) => session(path, format, arguments, terminal),
        (true, None) => Err(Usage(
            "say in which format to export the session: --to raw, aedat4, csv, npz, h5, png, exr or mp4".into(),
        )
        .into()),
        (false, Some(_)) => Err(Usage(format!(
            "--to is for sessions, and '{}' is none; without it, the Gaussians of a run are exported",
            path.display()
        ))
        .into()),
        (false, None) => run::run(&arguments.run, arguments.instants, arguments.out.as_deref(), terminal),
    }
}

/// One stream and where it goes.
struct Task {
    stream: usize,
    id: String,
    out: PathBuf,
}

fn session(path: &Path, format: Format, arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut session = Session::open(path)?;
    let tasks = tasks(&session, path, format, arguments)?;
    if format.is_of_events() {
        events::export(&mut session, format, &tasks, terminal)
    } else {
        frames::export(&mut session, format, &tasks, terminal)
    }
}

fn tasks(session: &Session, path: &Path, format: Format, arguments: &Arguments) -> anyhow::Result<Vec<Task>> {
    let fits = |encoding: erfgs_session::source::Encoding| match format {
        Format::Raw => {
            erfgs_session::codec::RawHeader::new(encoding, erfgs_session::codec::SensorSize::ALL, "", "").is_some()
        }
        format if format.is_of_events() => erfgs_session::codec::StreamDecoder::new(encoding, None).is_some(),
        _ => encoding.is_frames(),
    };
    let extension = format.extension();
    let chosen: Vec<usize> = match &arguments.stream {
        Some(id) => {
            let (stream, found) = session.stream(id)?;
            if !fits(found.description.encoding) {
                let encoding = found.description.encoding;
                return Err(
                    Usage(format!("stream '{id}' is {encoding}, which cannot be written as {extension}")).into()
                );
            }
            vec![stream]
        }
        None => {
            let streams = session.summary().streams.iter().enumerate();
            streams.filter(|(_, stream)| fits(stream.description.encoding)).map(|(stream, _)| stream).collect()
        }
    };
    if chosen.is_empty() {
        return Err(Usage(format!("{} has no stream that can be written as {extension}", path.display())).into());
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let task = |stream: usize| {
        let id = session.summary().streams[stream].description.id.clone();
        let name = if format.is_folder() { id.clone() } else { format!("{id}.{extension}") };
        let out = match &arguments.out {
            Some(out) if arguments.stream.is_some() => out.clone(),
            Some(folder) => folder.join(name),
            None => path.with_file_name(format!("{stem}.{name}")),
        };
        Task { stream, id, out }
    };
    Ok(chosen.into_iter().map(task).collect())
}
