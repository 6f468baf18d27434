//! `erfgs import`: an event file of another program becomes a session, and so do the files of several cameras.

mod plan;

use std::path::{Path, PathBuf};

use erfgs_session::container::{self, Recording};
use serde::Serialize;

use crate::{
    errors::{Usage, recording_at},
    event_file::EventFileOptions,
    export::complain_of,
    terminal::{Terminal, bytes, thousands},
};

/// Make a session of an event file, or of event files, pictures and videos of several cameras.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The words of a RAW file stay as they are. DAT, AEDAT 2 and Metavision's HDF5 become EVT 2 words; all else, AEDAT 4, text, NPZ and \
DSEC's HDF5 packets of AEDAT 4, with frames, inertial samples and triggers. Events keep their order and their microseconds: \
`erfgs info --digest` prints the same digests for the file and for the session. `erfgs replay` and `erfgs export` take event files as they \
are; `sync`, `calibrate` and `dataset import session` need a session.

Of a folder with the files of several cameras (event files, videos, folders of PNG or JPEG) a plan is drafted: import.toml, which \
says for each when it was recorded. Where the pulses at the trigger input of an event camera are as many as the frames of another, it \
says that they belong together. Complete it, and import it: all of it becomes one session (docs/guide/recordings-of-others.md).

Examples:
  erfgs import recordings/                       drafts recordings/import.toml
  erfgs import recordings/import.toml --out take1.mcap
  erfgs import davis346.aedat4
  erfgs import recording.raw --out take1.mcap
  erfgs import events.csv --size 640x480 --out events.mcap")]
pub struct Arguments {
    /// The event file (RAW, DAT, AEDAT 2 or 4, Event Stream, text, also in a zip, NPZ, NPY, HDF5), a plan (*.toml), or a
    /// folder to draft one of.
    #[arg(value_name = "FILE|PLAN.toml|FOLDER")]
    file: PathBuf,
    /// The session to write. Default: beside the file, named *.mcap.
    #[arg(long, value_name = "S.mcap")]
    out: Option<PathBuf>,
    #[command(flatten)]
    file_is: EventFileOptions,
}

#[derive(Serialize)]
struct Imported {
    file: PathBuf,
    stream: String,
    encoding: String,
    packets: u64,
    bytes: u64,
    seconds: f64,
}

/// Refuses the name of a file that is no session.
fn check_out(out: &Path) -> Result<(), Usage> {
    match out.extension() {
        Some(extension) if extension == "mcap" => Ok(()),
        _ => Err(Usage(format!("'{}' names no session: sessions end in .mcap", out.display()))),
    }
}

/// Writes the session and says what it holds.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let is_plan = arguments.file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    if is_plan || arguments.file.is_dir() {
        if let Some(option) = arguments.file_is.given() {
            return Err(Usage(format!("{option} is of one event file; of several the plan says it for each")).into());
        }
        if is_plan {
            return plan::run(&arguments.file, arguments.out.as_deref(), terminal);
        }
        return match &arguments.out {
            Some(_) => {
                Err(Usage("--out is for the session; of a folder a plan is drafted first, without it".into()).into())
            }
            None => plan::draft(&arguments.file, terminal),
        };
    }
    let out = arguments.out.clone().unwrap_or_else(|| arguments.file.with_extension("mcap"));
    let file = recording_at(&arguments.file)?;
    check_out(&out)?;
    let recording = match Recording::open_with(&file, &arguments.file_is.hints())? {
        Recording::EventFile(recording) => recording,
        Recording::Session(_) => {
            let file = arguments.file.display();
            return Err(Usage(format!("{file} is a recording in MCAP already: every command takes it as it is")).into());
        }
    };
    let last_ns = recording.summary().span_ns().map_or(0, |[_, last]| last);
    let progress = terminal.progress("importing");
    let totals = container::import_events(&recording, &out, |ns| {
        progress.update(ns.max(0).cast_unsigned(), last_ns.max(1).cast_unsigned(), "ns");
    })?;
    drop(progress);
    let described = recording.summary().streams.first().map(|stream| &stream.description);
    let stream = totals.streams.values().next().copied().unwrap_or_default();
    let imported = Imported {
        file: out,
        stream: described.map_or(String::new(), |described| described.id.clone()),
        encoding: described.map_or(String::new(), |described| described.encoding.to_string()),
        packets: stream.packets,
        bytes: stream.bytes,
        seconds: last_ns as f64 * 1e-9,
    };
    terminal.result(&imported, || {
        format!(
            "{}: stream {}, {}, {} packets, {}, {:.3} s",
            imported.file.display(),
            imported.stream,
            imported.encoding,
            thousands(imported.packets),
            bytes(imported.bytes),
            imported.seconds
        )
    })?;
    complain_of("imported", &arguments.file, recording.summary(), &[])
}
