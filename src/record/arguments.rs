//! The words of `erfgs record`.

use std::{net::SocketAddr, path::PathBuf};

use erfgs_recorder::{self as record, AlarmKind};
use erfgs_session::container::Split;

use super::hosts;
use crate::quick;

/// Record a rig of cameras into a session file.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs record --example > RIG.toml              start from the annotated example
  erfgs record RIG.toml --out take1.mcap         until Ctrl-C
  erfgs record RIG.toml --out take1.mcap --seconds 30 --live
  erfgs record RIG.toml --out long.mcap --split 10GB             long.mcap, long.001.mcap, ..., read as one session
  erfgs record RIG.toml --out takes/ --wait --live 0.0.0.0:8100
  erfgs record RIG.toml --out takes/ --before 5 --after 2 --live       Enter or the page keeps the last 5 s and 2 s more
  erfgs record RIG.toml --out takes/ --before 1 --after 1 --on rate:4  as does a rise of an event camera's rate
  erfgs record RIG.toml --out boards.mcap --live --quick chessboard:9x6:0.025

Examples: several hosts with one trigger board
  erfgs record right.toml --out takes/ --wait --live 0.0.0.0:8100      on each of the others: it prints the link
  erfgs record left.toml --out take1.mcap --seconds 30 --with 'http://right:8100/?token=TOKEN'
  erfgs record left.toml --out takes/ --wait --live --with hosts.txt   one page for all; a link a line

With --live a web page shows every camera, rates, drops, clocks and the disk, and starts and stops recordings in the folder \
of --out. Every request needs a token, which is part of the printed link.

Exit codes: 0 recorded, 1 a device or the disk failed (what was recorded stays readable), 2 wrong usage, 130 stopped by \
Ctrl-C before --seconds were over. docs/guide/recording.md says what the numbers mean and what to do about drops.")]
pub struct Arguments {
    /// The rig: which devices, with which settings.
    #[arg(value_name = "RIG.toml", required_unless_present = "example")]
    pub(super) rig: Option<PathBuf>,
    /// The session file to write; with --wait, the folder for recordings.
    #[arg(long, value_name = "S.mcap", required_unless_present = "example")]
    pub(super) out: Option<PathBuf>,
    /// Stop after this many seconds.
    #[arg(long, value_name = "N", conflicts_with = "wait")]
    pub(super) seconds: Option<f64>,
    /// Go on in another file before one is longer than this size, or after this time: 10GB, 500MB, 5min, 90s. The files are
    /// named S.mcap, S.001.mcap, S.002.mcap and so on. Commands that are given S.mcap read them all as one session; each of them
    /// is a whole MCAP file by itself, too.
    #[arg(long, value_name = "SIZE|TIME")]
    pub(super) split: Option<Split>,
    /// Serve the live page.
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = "127.0.0.1:8100")]
    pub(super) live: Option<SocketAddr>,
    /// A host name under which the live page may be opened, besides `localhost` and IP addresses.
    #[arg(long, value_name = "NAME", requires = "live")]
    pub(super) live_name: Vec<String>,
    /// Let every user of this machine use the live page without a token: watch, start, stop and download.
    #[arg(long, requires = "live")]
    pub(super) open: bool,
    /// Only show the cameras; record when the live page says so.
    #[arg(long, requires = "live")]
    pub(super) wait: bool,
    /// Keep the last seconds in memory and write them only on a trigger: Enter, the live page or --on. Each recording starts
    /// with the kept seconds; its file in the folder --out is named after the rig and the time.
    #[arg(long, value_name = "SECONDS", value_parser = held, conflicts_with = "seconds")]
    pub(super) before: Option<f64>,
    /// End such a recording this many seconds after its trigger. Default: it runs until the page or Enter stops it.
    #[arg(long, value_name = "SECONDS", value_parser = held, requires = "before")]
    pub(super) after: Option<f64>,
    /// Record together with another host: the link of its live page (run it with --wait), or a file with one link a line,
    /// which hides the tokens from other users of this machine. May be given more than once. The other hosts start first and
    /// stop with this one; the page shows their cameras, too.
    #[arg(long, value_name = "URL", conflicts_with = "before")]
    pub(super) with: Vec<hosts::With>,
    /// Another trigger of --before. rate:TIMES: the data rate of an event camera rises above TIMES its mean over the last
    /// two seconds. edge: the trigger input of an event camera rises. edge:ID: that of this camera. May be given twice.
    #[arg(long, value_name = "RISE", value_parser = alarm, requires = "before")]
    pub(super) on: Vec<AlarmKind>,
    #[command(flatten)]
    pub(super) quick: quick::QuickOptions,
    /// Measure the speed of the disk for this many seconds before the recording; 0 skips it.
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = disk_test, conflicts_with = "no_preflight")]
    pub(super) disk_test: f64,
    /// Skip the checks of disk, buses and memory.
    #[arg(long)]
    pub(super) no_preflight: bool,
    /// Print an annotated RIG.toml with every field, and do nothing else.
    #[arg(long, exclusive = true)]
    pub(super) example: bool,
}

fn held(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().ok().filter(|seconds| (0.01..=3600.0).contains(seconds));
    seconds.ok_or_else(|| "write 0.01 to 3600 seconds".into())
}

fn alarm(text: &str) -> Result<AlarmKind, String> {
    let wrong = || "write rate:TIMES with a number above 1, edge, or edge:ID".to_owned();
    match text.split_once(':') {
        None if text == "edge" => Ok(AlarmKind::Edge(None)),
        Some(("edge", id)) if record::is_id(id) => Ok(AlarmKind::Edge(Some(id.to_owned()))),
        Some(("rate", times)) => {
            let times = times.parse::<f64>().ok().filter(|times| *times > 1.0 && times.is_finite());
            times.map(AlarmKind::Rate).ok_or_else(wrong)
        }
        _ => Err(wrong()),
    }
}

fn disk_test(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().ok().filter(|seconds| (0.0..=60.0).contains(seconds));
    seconds.ok_or_else(|| "write 0 to 60 seconds".into())
}
