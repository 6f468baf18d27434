//! `erfgs bench decode`.

use std::path::PathBuf;

use anyhow::Context;
use erfgs_events::EventFile;
use erfgs_replay::bench::DecodeFigures;
use serde::Serialize;

use crate::{
    errors::Usage,
    event_file::EventFileOptions,
    terminal::{Terminal, table, thousands},
};

/// Measure the decoding of an event file from memory into columns, on one core, in pieces of 64 KiB as drivers give them.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The time is the CPU time of the fastest run, so that other work on the machine counts little; `wall_seconds` is the \
fastest run by the clock.

Examples:
  erfgs bench decode recording.raw
  erfgs bench decode recording.raw --runs 100 --json")]
pub struct Arguments {
    /// An event file.
    file: PathBuf,
    /// Number of runs; the fastest one counts.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    #[command(flatten)]
    file_is: EventFileOptions,
}

#[derive(Serialize)]
struct Measured {
    file: PathBuf,
    #[serde(flatten)]
    figures: DecodeFigures,
}

/// Measures and prints a line.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let extension = arguments.file.extension().unwrap_or_default().to_ascii_lowercase();
    if ["npz", "npy", "zip", "h5", "hdf5"].iter().any(|arrays| extension == *arrays) {
        let what = "archives and arrays (NPZ, NPY, HDF5) are not streams to decode; give a RAW, DAT, AEDAT, \
                    Event Stream or CSV file";
        return Err(Usage(what.to_owned()).into());
    }
    if extension == "mcap" {
        let file = arguments.file.display();
        let what =
            format!("{file} is a session: `erfgs export {file} --to raw` gives a file of its words, or --to aedat4");
        return Err(Usage(what).into());
    }
    let file = EventFile::open_with(&arguments.file, &arguments.file_is.hints())?;
    let content =
        std::fs::read(&file.path).with_context(|| format!("cannot read {} into memory", file.path.display()))?;
    let body = content.get(file.body as usize..).unwrap_or_default();
    let figures = erfgs_replay::bench::decode(&file, body, arguments.runs);
    let measured = Measured { file: arguments.file.clone(), figures };
    terminal.result(&measured, || {
        let figures = &measured.figures;
        let heading = ["format", "events", "ms", "Mev/s", "MiB/s"].map(String::from).to_vec();
        let row = vec![
            figures.format.to_owned(),
            thousands(figures.events),
            format!("{:.3}", figures.seconds * 1e3),
            format!("{:.1}", figures.mev_per_s),
            format!("{:.1}", figures.mib_per_s),
        ];
        table(&[heading, row])
    })
}
