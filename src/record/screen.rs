//! What is shown of a recording: a line of status and messages while it runs, a table after it.

use std::{
    io::{IsTerminal, Write},
    time::{Duration, Instant},
};

use erfgs_recorder::{self as record, Level, Message, Status, Summary, hosts::HostView};
use serde::Serialize;

use super::hosts;
use crate::{
    progress::duration,
    terminal::{Terminal, bytes, table, thousands},
};

/// Between two status lines: on a terminal, elsewhere.
const LINE: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(10)];

/// Status line and messages on stderr.
pub(super) struct Screen {
    quiet: bool,
    is_terminal: bool,
    last_line: Option<Instant>,
    last_message: u64,
}

impl Screen {
    pub(super) fn new(terminal: &Terminal) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        Self { quiet: terminal.is_quiet(), is_terminal, last_line: None, last_message: 0 }
    }

    pub(super) fn show(&mut self, status: &Status, hosts: &[HostView]) {
        self.messages(&status.messages);
        let between = LINE[usize::from(!self.is_terminal)];
        if self.quiet || self.last_line.is_some_and(|at| at.elapsed() < between) {
            return;
        }
        self.last_line = Some(Instant::now());
        let line = line(status) + &hosts::line(hosts);
        if self.is_terminal {
            eprint!("\r\x1b[2K{line}");
            let _ = std::io::stderr().flush();
        } else {
            eprintln!("{line}");
        }
    }

    /// Prints messages that are new.
    pub(super) fn messages(&mut self, messages: &[Message]) {
        let shown = self.last_message;
        for message in messages.iter().filter(|message| message.number > shown) {
            if !self.quiet || message.level == Level::Error {
                self.clear();
                let who = if message.stream.is_empty() { String::new() } else { format!("{}: ", message.stream) };
                let mark = match message.level {
                    Level::Info => "",
                    Level::Warning => "warning: ",
                    Level::Error => "ERROR: ",
                };
                eprintln!("{mark}{who}{}", message.text);
            }
        }
        self.last_message = messages.last().map_or(self.last_message, |message| message.number);
    }

    pub(super) fn clear(&mut self) {
        if self.is_terminal && !self.quiet {
            eprint!("\r\x1b[2K");
        }
        self.last_line = None;
    }
}

/// `recording 12.0 s | 1.2 GiB at 412.0 MB/s | 14 streams | 21.3 Mev/s | queue 3 % | dropped 0 | disk 52 min left`
fn line(status: &Status) -> String {
    let mut parts = match &status.recording {
        Some(recording) => vec![
            format!("recording {}", duration(recording.seconds)),
            format!(
                "{}{} at {:.1} MB/s",
                bytes(recording.bytes),
                in_files(recording.files),
                recording.bytes_per_s / 1e6
            ),
        ],
        None if status.finishing.is_some() => vec!["writing what waits".to_owned()],
        None => {
            let held = status.held.map(|held| {
                format!("holding {:.1} of {:.1} s in {}", held.seconds, held.of_seconds, bytes(held.bytes))
            });
            let what = held.unwrap_or_else(|| "not recording".to_owned());
            vec![what, format!("{:.1} MB/s", status.bytes_per_s() / 1e6)]
        }
    };
    let running = status.streams.iter().filter(|stream| stream.state == record::StreamState::Running).count();
    parts.push(format!("{running} of {} streams", status.streams.len()));
    let events: f64 = status.streams.iter().filter_map(|stream| stream.events_per_s).sum();
    if events > 0.0 {
        parts.push(format!("{:.1} Mev/s", events / 1e6));
    }
    let full = |stream: &record::StreamStatus| stream.waiting_bytes as f64 / stream.queue_bytes.max(1) as f64;
    let fullest = status.streams.iter().map(full).fold(0.0, f64::max);
    parts.push(format!("queue {:.0} %", 100.0 * fullest));
    parts.push(format!("dropped {}", thousands(status.drops())));
    if let Some(seconds) = status.disk.seconds_left {
        parts.push(format!("disk {} left", duration(seconds)));
    }
    parts.join(" | ")
}

/// ` in 3 files`, where there are several.
fn in_files(files: u32) -> String {
    if files > 1 { format!(" in {files} files") } else { String::new() }
}

/// What is told with `--json`.
#[derive(Serialize)]
pub(super) struct Recorded<'a> {
    #[serde(flatten)]
    pub(super) summary: &'a Summary,
    #[serde(flatten)]
    pub(super) others: Option<&'a hosts::Others>,
}

/// What a recording holds, for humans.
pub(super) fn report(summary: &Summary) -> String {
    let head = ["stream", "packets", "data", "dropped by driver", "queue", "writer", "most in memory"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for stream in &summary.streams {
        rows.push(vec![
            stream.id.clone(),
            thousands(stream.written),
            bytes(stream.written_bytes),
            thousands(stream.drops.driver),
            thousands(stream.drops.queue),
            thousands(stream.drops.writer),
            bytes(stream.peak_waiting_bytes),
        ]);
    }
    format!(
        "{}\n{}: {}, {}{}; {}\n",
        table(&rows),
        summary.path.display(),
        duration(summary.seconds),
        bytes(summary.bytes),
        in_files(summary.files),
        summary.reason
    )
}
