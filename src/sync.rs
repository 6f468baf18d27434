//! `erfgs sync`: fit the clocks of a session anew.

use std::path::{Path, PathBuf};

use erfgs_base::FileError;
use erfgs_session::container::{Session, Summary};
use erfgs_sync::{Row, StreamSync, SyncFileError, SyncNote, SyncOptions, Synchronisation, page, synchronise};

use crate::terminal::{Terminal, table, thousands};

/// Fit the clocks of a session anew and plot how well they fit.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Ties every stream to the session clock, in one of four tiers:
  S  strobe: both ends of each exposure, as an event camera saw them at its trigger input
  A  hardware-triggered: edges and frames are matched with the trigger board's pulses, or with those of a generator
  B  free-running: event cameras by the arrival of their data, frames by the kernel's stamps
  C  as B, with the lag measured by a flashing lamp (--flash)
A device that restarts during the recording gets one clock, and one row, for each part of its stream. The fits are written \
beside the session (S.sync.json, described in docs/reference/session.md), with a page that plots the residuals (S.sync.html). \
The session is not changed.

Examples:
  erfgs sync S.mcap
  erfgs sync S.mcap --flash                      the wand's LED blinked before all cameras
  erfgs sync S.mcap --json | jq '.streams[] | {id, tier}'")]
pub struct Arguments {
    /// The session.
    session: PathBuf,
    /// Find a lamp that flashed in view of event cameras and free-running cameras, and measure the lag of the free-running
    /// cameras by it. Decodes every frame, which is slow.
    #[arg(long)]
    flash: bool,
    /// The file to write the fits to. Default: beside the session.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The page to write the plots to. Default: beside the fits.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// The session's clocks: as `erfgs sync` left them in the file beside it, or fitted now.
pub fn of_session(session: &mut Session, terminal: &Terminal) -> anyhow::Result<Synchronisation> {
    let progress = terminal.progress("fitting clocks");
    let mut note = |note: SyncNote| terminal.note(note.to_string());
    Ok(erfgs_sync::of_session(session, &mut note, |bytes, total| progress.update(bytes, total, "bytes"))?)
}

/// The clocks in the file beside a recording, if there is one that fits.
pub fn kept(path: &Path, summary: &Summary, terminal: &Terminal) -> Result<Option<Synchronisation>, SyncFileError> {
    erfgs_sync::kept(path, summary, &mut |note| terminal.note(note.to_string()))
}

fn fit(session: &mut Session, options: SyncOptions, terminal: &Terminal) -> anyhow::Result<Synchronisation> {
    let total: u64 = session.summary().streams.iter().map(|stream| stream.totals.bytes).sum();
    let progress = terminal.progress("fitting clocks");
    Ok(synchronise(session, options, |bytes| progress.update(bytes, total, "bytes"))?)
}

/// Fits, writes and tells.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut session = Session::open(&arguments.session)?;
    let sync = fit(&mut session, SyncOptions { flash: arguments.flash }, terminal)?;
    let out = arguments.out.clone().unwrap_or_else(|| Synchronisation::file_beside(session.path()));
    let plot = arguments.plot.clone().unwrap_or_else(|| out.with_extension("html"));
    sync.save(&out)?;
    erfgs_base::atomic::write(&plot, page(&sync).as_bytes()).map_err(FileError::when("write", &plot))?;
    terminal.result(&sync, || {
        let head = ["stream", "tier", "samples", "outliers", "rate error", "residual p50", "p95", "max"];
        let mut rows = vec![head.map(str::to_owned).to_vec()];
        rows.extend(sync.streams.iter().flat_map(StreamSync::rows).map(row));
        let mut text = table(&rows);
        for stream in &sync.streams {
            for note in stream.faults.iter().chain(&stream.notes) {
                text.push_str(&format!("{}: {note}\n", stream.id));
            }
        }
        text.push_str(&format!("written: {} and {}", out.display(), plot.display()));
        text
    })
}

fn row(row: Row) -> Vec<String> {
    let us = |ns: f64| format!("{:.1} µs", ns / 1000.0);
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    vec![
        row.name,
        row.tier.name().to_owned(),
        thousands(row.samples),
        or_dash(row.outliers.map(|share| format!("{:.1} %", 100.0 * share))),
        or_dash(row.rate_ppm.map(|ppm| format!("{ppm:+.2} ppm"))),
        us(row.residuals.p50_ns),
        us(row.residuals.p95_ns),
        us(row.residuals.max_ns),
    ]
}
