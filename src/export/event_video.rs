//! The events of a recording as videos.

use std::path::PathBuf;

use erfgs_bridge::foxglove::EventPictures;
use erfgs_session::{
    container::Recording,
    export::{EventVideo, write_event_video},
    source::Encoding,
};
use serde::Serialize;

use super::{StreamExport, Task};
use crate::{
    errors::Usage,
    terminal::{Terminal, thousands},
};

/// Which pictures of events a format has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pictures {
    /// None.
    None,
    /// At a steady rate of the recording.
    Steady,
    /// A video, at a speed of its own.
    Video,
}

/// How events become pictures.
#[derive(Debug, clap::Args)]
pub struct VideoOptions {
    /// Duration of the events in each picture, milliseconds. Default: the time from picture to picture.
    #[arg(long, value_name = "MS", value_parser = positive, help_heading = "Of pictures of events (mp4, foxglove)")]
    accumulate: Option<f64>,
    /// Pictures a second of the video, or of the recording (foxglove) [default: 30].
    #[arg(long, value_name = "N", value_parser = positive, help_heading = "Of pictures of events (mp4, foxglove)")]
    fps: Option<f64>,
    /// How many times as fast as it happened a video (mp4) plays: 0.01 is a hundred times slower [default: 1].
    #[arg(long, value_name = "TIMES", value_parser = positive, help_heading = "Of pictures of events (mp4, foxglove)")]
    speed: Option<f64>,
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (1e-6..=1e6).contains(number));
    number.ok_or_else(|| "a number from 0.000001 to 1000000".into())
}

impl VideoOptions {
    /// Refuses what is given for another format.
    pub fn fits(&self, pictures: Pictures) -> Result<(), Usage> {
        let some = pictures != Pictures::None;
        let given = [
            ("--accumulate", self.accumulate, some, "pictures of events: --to mp4 or foxglove"),
            ("--fps", self.fps, some, "pictures of events: --to mp4 or foxglove"),
            ("--speed", self.speed, pictures == Pictures::Video, "videos of events: --to mp4"),
        ];
        match given.into_iter().find(|(_, value, fits, _)| value.is_some() && !fits) {
            Some((name, _, _, of)) => Err(Usage(format!("{name} is for {of}"))),
            None => Ok(()),
        }
    }

    /// As pictures at a steady rate.
    pub fn steady(&self) -> EventPictures {
        let rate_hz = self.fps.unwrap_or(EventPictures::default().rate_hz);
        EventPictures { rate_hz, span_ns: self.accumulate.map(|ms| (1e6 * ms) as i64) }
    }

    /// Whether a stream's events are shown, and not its frames.
    pub fn shows_events_of(&self, encoding: Encoding) -> bool {
        encoding.is_events() && (self.accumulate.is_some() || !encoding.has_sensor_frames())
    }
}

#[derive(Serialize)]
struct Exported {
    stream: String,
    path: PathBuf,
    frames: u64,
    events: u64,
    /// Device time of the first picture, microseconds.
    first_us: u64,
    /// From picture to picture, microseconds.
    step_us: f64,
    /// Long times without events, and breaks, that were left out.
    left_out: u64,
}

/// Writes the videos, and what is to be exports of each.
pub fn export(
    recording: &mut Recording,
    options: &VideoOptions,
    tasks: &[Task],
    lost: &mut Vec<String>,
    terminal: &Terminal,
) -> anyhow::Result<Vec<StreamExport>> {
    let default = EventVideo::default();
    let video = EventVideo {
        fps: options.fps.unwrap_or(default.fps),
        speed: options.speed.unwrap_or(default.speed),
        span_us: options.accumulate.map(|ms| ((1000.0 * ms) as u64).max(1)),
    };
    let mut exports = Vec::new();
    for task in tasks {
        let total = recording.summary().streams[task.stream].totals.bytes;
        let progress = terminal.progress(&task.id);
        let update = |done: u64| progress.update(done, total, "bytes");
        let written = write_event_video(recording, &task.id, video, &task.out, lost, update)?;
        let left_out = match written.left_out {
            0 => String::new(),
            count => format!("; {count} stretches without events, or breaks, are left out"),
        };
        let (events, apart_ms) = (thousands(written.events), written.step_us / 1e3);
        let line = match written.frames {
            0 => format!("{}: no events", task.id),
            frames => {
                format!(
                    "{}: {frames} pictures of {events} events, {apart_ms:.3} ms apart{left_out}",
                    task.out.display()
                )
            }
        };
        let exported = Exported {
            stream: task.id.clone(),
            path: task.out.clone(),
            frames: written.frames,
            events: written.events,
            first_us: written.first_us,
            step_us: written.step_us,
            left_out: written.left_out,
        };
        exports.push(StreamExport { exported: serde_json::to_value(exported)?, is_empty: written.frames == 0, line });
    }
    Ok(exports)
}
