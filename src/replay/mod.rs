//! `erfgs replay`: play a recording as if its devices were there.

mod audience;
mod steering;

use std::{
    net::SocketAddr,
    path::PathBuf,
    sync::atomic::Ordering,
    time::{Duration, Instant},
};

use audience::Audience;
use erfgs_replay::{Player, PlayerOptions, Speed};
use serde::Serialize;

use crate::{
    errors::{Usage, recording_at},
    event_file::EventFileOptions,
    export::complain_of,
    interrupt, quick,
    terminal::{Terminal, bytes, table, thousands},
};

/// Play a session or an event file as if its devices were there.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Plays the recorded streams with their original timing through the same interface as devices. A status line shows the position \
and the rates. With --live the streams appear on the live page, until Ctrl-C; the page can pause, step by milliseconds or \
frames, seek, change the speed, and record what is played into the recording's folder. An event file of another program is \
one stream; it is first read once to find its length.

Exit codes: 0 played, 1 the recording is cut off or damaged (all else was played), 2 wrong usage.

Examples:
  erfgs replay S.mcap
  erfgs replay S.mcap --speed 0.1 --seek 12.5
  erfgs replay S.mcap --live --loop
  erfgs replay boards.mcap --live --quick chessboard:9x6:0.025
  erfgs replay davis346.aedat4 --live
  erfgs replay S.mcap --speed max --json")]
pub struct Arguments {
    /// The session, an MCAP recording of ROS 2 with packets of events, or an event file: RAW, DAT, AEDAT, Event Stream, text, NPZ, NPY, HDF5, rosbag2.
    #[arg(value_name = "S.mcap|FILE")]
    session: PathBuf,
    /// Playback speed: 0.1 is ten times slower than recorded, max as fast as the disk delivers.
    #[arg(long, value_name = "TIMES", default_value = "1", value_parser = speed)]
    speed: Speed,
    /// Start over at the end.
    #[arg(long = "loop")]
    repeat: bool,
    /// Start this many seconds after the beginning.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = crate::parse::seconds)]
    seek: f64,
    #[command(flatten)]
    file_is: EventFileOptions,
    /// Show it on the live page.
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = "127.0.0.1:8100")]
    live: Option<SocketAddr>,
    /// A host name under which the live page may be opened, besides `localhost` and IP addresses.
    #[arg(long, value_name = "NAME", requires = "live")]
    live_name: Vec<String>,
    /// Let every user of this machine use the live page without a token: watch, start, stop and download.
    #[arg(long, requires = "live")]
    open: bool,
    #[command(flatten)]
    quick: quick::QuickOptions,
}

fn speed(text: &str) -> Result<Speed, String> {
    if text == "max" {
        return Ok(Speed::Max);
    }
    match text.parse::<f64>() {
        Ok(times) if times >= 0.001 && times.is_finite() => Ok(Speed::Times(times)),
        _ => Err("a speed is a number from 0.001 on, or max".into()),
    }
}

#[derive(Serialize)]
struct Played {
    seconds: f64,
    streams: Vec<PlayedStream>,
}

#[derive(Serialize)]
struct PlayedStream {
    id: String,
    packets: u64,
    bytes: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    incidents: Option<u64>,
}

/// Plays until the end, or until the user stops.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    recording_at(&arguments.session)?;
    let seek_ns = (arguments.seek * 1e9) as i64;
    let Arguments { speed, repeat, file_is, .. } = arguments;
    let options = PlayerOptions { speed: *speed, repeat: *repeat, seek_ns, hints: file_is.hints() };
    let player = Player::open(&arguments.session, options)?;
    let summary = player.summary();
    if summary.streams.is_empty() {
        let path = arguments.session.display();
        return Err(
            Usage(format!("{path} has no streams that erfgs can play; `erfgs info {path}` says what it has")).into()
        );
    }
    let length_ns = summary.span_ns().map_or(0, |[_, last]| summary.start.session_ns(last)).max(1);
    if seek_ns > length_ns {
        let (path, seconds) = (arguments.session.display(), length_ns as f64 * 1e-9);
        let what = format!("--seek {} is behind the end: {path} is {seconds:.3} s long", arguments.seek);
        return Err(Usage(what).into());
    }
    let stop = interrupt::stop_flag("the playback ends")?;
    let mut audience = match arguments.live {
        Some(address) => Audience::live(&player, arguments, address)?,
        None => Audience::counting(&player),
    };
    if let Some(url) = audience.url() {
        terminal.note(format!("live page: {url} (Ctrl-C ends it)"));
    }
    let controls = player.controls();
    let begun = Instant::now();
    audience.start()?;
    let progress = terminal.progress("replaying");
    // A page stays when the playback is over: someone may look at it.
    while !stop.load(Ordering::Relaxed) && (audience.url().is_some() || !controls.finished()) {
        let total: u64 = audience.streams().iter().map(|stream| stream.bytes).sum();
        let position_ns = controls.position_ns().unwrap_or(0).clamp(0, length_ns);
        progress.share(position_ns as f64 / length_ns as f64, || {
            let rate = total as f64 / begun.elapsed().as_secs_f64().max(1e-3);
            format!("{:.2} s, {}/s", position_ns as f64 * 1e-9, bytes(rate as u64))
        });
        std::thread::sleep(Duration::from_millis(20));
    }
    audience.stop()?;
    drop(progress);
    let played = Played { seconds: begun.elapsed().as_secs_f64(), streams: audience.streams() };
    terminal.result(&played, || {
        let mut rows = vec![["stream", "packets", "bytes"].map(str::to_owned).to_vec()];
        for stream in &played.streams {
            rows.push(vec![stream.id.clone(), thousands(stream.packets), thousands(stream.bytes)]);
        }
        format!("{}in {:.2} s", table(&rows), played.seconds)
    })?;
    match (controls.damaged(), controls.failure()) {
        (0, Some(failure)) => anyhow::bail!("{failure}"),
        (places, Some(failure)) => {
            anyhow::bail!("the intact part was played; {places} damaged places were skipped, the last: {failure}")
        }
        (_, None) => complain_of("played", &arguments.session, player.summary(), &[]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_are_numbers_above_nothing_or_max() {
        assert_eq!(speed("max"), Ok(Speed::Max));
        assert_eq!(speed("0.1"), Ok(Speed::Times(0.1)));
        for wrong in ["0", "-1", "inf", "NaN", "fast"] {
            assert!(speed(wrong).is_err(), "{wrong}");
        }
    }
}
