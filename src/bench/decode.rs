//! `erfgs bench decode`.

use std::{path::PathBuf, time::Instant};

use anyhow::Context;
use erfgs_base::cpu;
use erfgs_events::{CdEvent, Columns, Decoder, EventBatch, EventFile, SensorSize, Sink};
use serde::Serialize;

use crate::{
    errors::Usage,
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
    /// The fastest of so many runs counts.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    /// Size of the sensor, if the file does not say it.
    #[arg(long, value_name = "WxH", value_parser = crate::parse::sensor_size)]
    size: Option<SensorSize>,
}

#[derive(Serialize)]
struct DecodeFigures {
    file: PathBuf,
    format: &'static str,
    bytes: u64,
    events: u64,
    seconds: f64,
    wall_seconds: f64,
    #[serde(rename = "Mev_per_s")]
    mev_per_s: f64,
    mib_per_s: f64,
}

/// Bytes decoded at once.
const PIECE: usize = 1 << 16;

/// Takes events alone.
struct Events(Columns);

impl Sink for Events {
    fn event(&mut self, event: CdEvent) {
        self.0.event(event);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.0.events(batch);
    }
}

/// Measures and prints a line.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let extension = arguments.file.extension().unwrap_or_default().to_ascii_lowercase();
    if ["npz", "npy", "zip", "h5", "hdf5"].iter().any(|arrays| extension == *arrays) {
        let what = "archives and arrays are read whole, and are no stream to decode; give a RAW, DAT, AEDAT, Event Stream \
                    or CSV file";
        return Err(Usage(what.to_owned()).into());
    }
    if extension == "mcap" {
        let file = arguments.file.display();
        let what =
            format!("{file} is a session: `erfgs export {file} --to raw` gives a file of its words, or --to aedat4");
        return Err(Usage(what).into());
    }
    let mut file = EventFile::open(&arguments.file)?;
    if let Some(size) = arguments.size {
        file = file.with_size(size);
    }
    let content =
        std::fs::read(&file.path).with_context(|| format!("cannot read {} into memory", file.path.display()))?;
    let body = content.get(file.body as usize..).unwrap_or_default();
    let mut events = Events(Columns::default());
    let mut count = 0;
    let (mut seconds, mut wall_seconds) = (f64::INFINITY, f64::INFINITY);
    // The first run makes room and does not count.
    for run in 0..=arguments.runs {
        let mut decoder = file.decoder();
        let (from, cpu_from) = (Instant::now(), cpu::thread_seconds());
        count = 0;
        for piece in body.chunks(PIECE) {
            events.0.clear_events();
            decoder.decode(piece, &mut events);
            count += events.0.len() as u64;
        }
        events.0.clear_events();
        decoder.finish(&mut events);
        count += events.0.len() as u64;
        let (wall, cpu) = (from.elapsed().as_secs_f64(), cpu::thread_seconds());
        if run > 0 {
            wall_seconds = wall_seconds.min(wall);
            seconds = seconds.min(cpu.zip(cpu_from).map_or(wall, |(to, from)| to - from));
        }
    }
    let figures = DecodeFigures {
        file: arguments.file.clone(),
        format: file.format.name(),
        bytes: body.len() as u64,
        events: count,
        seconds,
        wall_seconds,
        mev_per_s: count as f64 / seconds * 1e-6,
        mib_per_s: body.len() as f64 / seconds / f64::from(1 << 20),
    };
    terminal.result(&figures, || {
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
