//! `erfgs replay`: play a session as if its devices were there.

use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use erfgs_replay::{Player, PlayerOptions, Speed};
use erfgs_session::source::{Incident, Outlet, Packet, Source};
use serde::Serialize;

use crate::{
    errors::Usage,
    interrupt,
    terminal::{Terminal, bytes, table, thousands},
};

/// Play a session as if its devices were there.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The session's streams are played with the times between their packets, into the same interface that devices record
through. A line says where the playback is and what passes.

Examples:
  erfgs replay S.mcap
  erfgs replay S.mcap --speed 0.1 --seek 12.5
  erfgs replay S.mcap --speed max --json")]
pub struct Arguments {
    /// The session, or an MCAP recording of ROS 2 with packets of events.
    session: PathBuf,
    /// How fast: 0.1 is ten times slower than it was recorded, max as fast as the disk gives it.
    #[arg(long, value_name = "TIMES", default_value = "1", value_parser = speed)]
    speed: Speed,
    /// Start over at the end.
    #[arg(long = "loop")]
    repeat: bool,
    /// Start so many seconds after the beginning.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = seconds)]
    seek: f64,
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

fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "a number of seconds".to_owned())?;
    if value >= 0.0 && value.is_finite() { Ok(value) } else { Err("a number of seconds, 0 or more".into()) }
}

/// Counts what passes.
#[derive(Default)]
struct Counting {
    packets: AtomicU64,
    bytes: AtomicU64,
    incidents: AtomicU64,
}

impl Outlet for Counting {
    fn send(&self, packet: Packet) -> bool {
        self.packets.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(packet.payload.len() as u64, Ordering::Relaxed);
        true
    }

    fn report(&self, _incident: Incident) {
        self.incidents.fetch_add(1, Ordering::Relaxed);
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
    incidents: u64,
}

/// Plays until the end, or until the user stops.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let options =
        PlayerOptions { speed: arguments.speed, repeat: arguments.repeat, seek_ns: (arguments.seek * 1e9) as i64 };
    let player = Player::open(&arguments.session, options)?;
    let summary = player.summary();
    if summary.streams.is_empty() {
        let path = arguments.session.display();
        return Err(
            Usage(format!("{path} has no streams that erfgs can play; `erfgs info {path}` says what it has")).into()
        );
    }
    let length_ns = summary.span_ns().map_or(0, |[_, last]| summary.start.session_ns(last)).max(1);
    let stop = interrupt::stop_flag("the playback ends")?;
    let mut sources = player.sources();
    let counting: Vec<Arc<Counting>> = sources.iter().map(|_| Arc::default()).collect();
    let controls = player.controls();
    let begun = Instant::now();
    for (source, outlet) in std::iter::zip(&mut sources, &counting) {
        source.start(outlet.clone()).map_err(anyhow::Error::from_boxed)?;
    }
    let progress = terminal.progress("replaying");
    while !controls.finished() && !stop.load(Ordering::Relaxed) {
        let total: u64 = counting.iter().map(|counting| counting.bytes.load(Ordering::Relaxed)).sum();
        let position_ns = controls.position_ns().unwrap_or(0).clamp(0, length_ns);
        progress.share(position_ns as f64 / length_ns as f64, || {
            let rate = total as f64 / begun.elapsed().as_secs_f64().max(1e-3);
            format!("{:.2} s, {}/s", position_ns as f64 * 1e-9, bytes(rate as u64))
        });
        std::thread::sleep(Duration::from_millis(20));
    }
    for source in &mut sources {
        source.stop().map_err(anyhow::Error::from_boxed)?;
    }
    drop(progress);
    if let Some(failure) = controls.failure() {
        terminal.note(format!("passed over: {failure}"));
    }
    let played = Played {
        seconds: begun.elapsed().as_secs_f64(),
        streams: std::iter::zip(&sources, &counting)
            .map(|(source, counting)| PlayedStream {
                id: source.description().id.clone(),
                packets: counting.packets.load(Ordering::Relaxed),
                bytes: counting.bytes.load(Ordering::Relaxed),
                incidents: counting.incidents.load(Ordering::Relaxed),
            })
            .collect(),
    };
    terminal.result(&played, || {
        let mut rows = vec![["stream", "packets", "bytes"].map(str::to_owned).to_vec()];
        for stream in &played.streams {
            rows.push(vec![stream.id.clone(), thousands(stream.packets), thousands(stream.bytes)]);
        }
        format!("{}in {:.2} s", table(&rows), played.seconds)
    })
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
