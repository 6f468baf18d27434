//! `erfgs import`: an event file of another program becomes a session.

use std::path::PathBuf;

use erfgs_session::container::{self, Recording};
use serde::Serialize;

use crate::{
    errors::{Usage, recording_at},
    event_file::EventFileOptions,
    export::complain_of,
    terminal::{Terminal, bytes, thousands},
};

/// Make a session of an event file of another program.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The words of a RAW file stay as they are. DAT, AEDAT 2 and Metavision's HDF5 become EVT 2 words; all else, AEDAT 4, text, NPZ and \
DSEC's HDF5 packets of AEDAT 4, with frames, inertial samples and triggers. Events keep their order and their microseconds: \
`erfgs info --digest` prints the same digests for the file and for the session. `erfgs replay` and `erfgs export` take event files as they \
are; `sync`, `calibrate` and `dataset import session` need a session.

Examples:
  erfgs import davis346.aedat4
  erfgs import recording.raw --out take1.mcap
  erfgs import events.csv --size 640x480 --out events.mcap")]
pub struct Arguments {
    /// The event file: RAW, DAT, AEDAT 2 or 4, Event Stream, text (also in a zip), NPZ, NPY, HDF5.
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

/// Writes the session and says what it holds.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let out = arguments.out.clone().unwrap_or_else(|| arguments.file.with_extension("mcap"));
    let file = recording_at(&arguments.file)?;
    if out.extension().is_none_or(|extension| extension != "mcap") {
        return Err(Usage(format!("'{}' names no session: sessions end in .mcap", out.display())).into());
    }
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
