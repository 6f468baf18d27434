//! The event streams of a recording as files.

use std::path::PathBuf;

use erfgs_session::{
    container::Recording,
    export::{EventsFormat, write_events},
};
use serde::Serialize;

use super::Task;
use crate::terminal::{Terminal, bytes, thousands};

#[derive(Serialize)]
struct Exported {
    stream: String,
    file: PathBuf,
    bytes: u64,
    /// Events in the file; absent for raw that is not decoded.
    events: Option<u64>,
    /// What was taken off the times because the format could not hold them, microseconds.
    shift_us: u64,
    /// Places where data of the device was lost.
    discontinuities: u64,
}

/// Writes the streams and lists them.
pub fn export(
    recording: &mut Recording,
    format: EventsFormat,
    tasks: &[Task],
    terminal: &Terminal,
) -> anyhow::Result<()> {
    let mut files = Vec::new();
    let lost = &mut Vec::new();
    for task in tasks {
        let totals = recording.summary().streams[task.stream].totals;
        let progress = terminal.progress(&task.id);
        let update = |done: u64| progress.update(done, totals.bytes, "bytes");
        let written = write_events(recording, &task.id, format, &task.out, lost, update)?;
        files.push(Exported {
            events: written.events,
            shift_us: written.shift_us,
            stream: task.id.clone(),
            file: task.out.clone(),
            bytes: std::fs::metadata(&task.out).map_or(0, |metadata| metadata.len()),
            discontinuities: totals.discontinuities,
        });
    }
    terminal.result(&files, || {
        let line = |file: &Exported| {
            let events = file.events.map_or(String::new(), |events| format!(", {} events", thousands(events)));
            let cuts = match file.discontinuities {
                0 => String::new(),
                count => format!("; data was lost in {count} places"),
            };
            let shift = match file.shift_us {
                0 => String::new(),
                us => format!("; the format's times end before {us} us, which were taken off all times"),
            };
            format!("{}: {}{events}{cuts}{shift}", file.file.display(), bytes(file.bytes))
        };
        files.iter().map(line).collect::<Vec<_>>().join("\n")
    })?;
    super::complain(recording, lost)
}
