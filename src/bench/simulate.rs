//! `erfgs bench simulate`.

use std::path::PathBuf;

use erfgs_events::npz;
use erfgs_replay::bench::{Figures, moving_disc, simulate};

use crate::{
    simulate::Sensor,
    terminal::{Terminal, table, thousands},
};

/// Measure the event simulator.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs bench simulate
  erfgs bench simulate luma.npz --fps 30 --threads 1")]
pub struct Arguments {
    /// A video with `luma[T, H, W]`. Default: a textured disc that moves.
    luma: Option<PathBuf>,
    /// Frames a second.
    #[arg(long, default_value_t = 30.0)]
    fps: f64,
    /// Number of threads. Default: one, and all cores, both measured.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Number of runs; the fastest one counts.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    #[command(flatten)]
    sensor: Sensor,
}

/// Measures and prints a line for each number of threads.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let config = arguments.sensor.config(0)?;
    let (data, width, height) = match &arguments.luma {
        Some(path) => {
            let luma = npz::read_luma(path)?;
            (luma.data, luma.width, luma.height)
        }
        None => (moving_disc(640, 360, 45), 640, 360),
    };
    let all = std::thread::available_parallelism().map_or(1, usize::from);
    let counts = match arguments.threads {
        Some(threads) => vec![threads as usize],
        None if all > 1 => vec![1, all],
        None => vec![1],
    };
    let figures = counts
        .into_iter()
        .map(|threads| simulate(&data, width, height, arguments.fps, &config, threads, arguments.runs))
        .collect::<Result<Vec<Figures>, _>>()?;
    terminal.result(&figures, || {
        let mut rows = vec![["threads", "pixels", "events", "ms", "Mpix/s/core", "Mev/s"].map(String::from).to_vec()];
        rows.extend(figures.iter().map(|row| {
            vec![
                row.threads.to_string(),
                thousands(row.pixels),
                thousands(row.events),
                format!("{:.1}", row.seconds * 1e3),
                format!("{:.1}", row.mpix_per_s_per_core),
                format!("{:.1}", row.mevents_per_s),
            ]
        }));
        table(&rows)
    })
}
