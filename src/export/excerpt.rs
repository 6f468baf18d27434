//! A range of a recording as a session of its own.

use std::path::PathBuf;

use erfgs_session::container::{Recording, write_excerpt};
use serde::Serialize;

use super::Arguments;
use crate::{
    errors::Usage,
    terminal::{Terminal, bytes, thousands},
};

#[derive(Serialize)]
struct Written {
    file: PathBuf,
    bytes: u64,
    seconds: f64,
    streams: Vec<WrittenStream>,
}

#[derive(Serialize)]
struct WrittenStream {
    stream: String,
    packets: u64,
    bytes: u64,
}

/// Writes the session and says what it holds.
pub fn export(
    recording: &mut Recording,
    range: Option<[i64; 2]>,
    arguments: &Arguments,
    terminal: &Terminal,
) -> anyhow::Result<()> {
    let Some(out) = &arguments.out else {
        return Err(Usage("give --out NAME.mcap".into()).into());
    };
    if out.extension().is_none_or(|extension| extension != "mcap") {
        let named = out.with_extension("mcap");
        let what = format!("'{}' is not named as a session: write --out {}", out.display(), named.display());
        return Err(Usage(what).into());
    }
    if out.exists() {
        return Err(Usage(format!("'{}' exists already: recordings are never overwritten", out.display())).into());
    }
    let chosen = match &arguments.stream {
        Some(id) => Some(vec![recording.stream(id)?.0]),
        None => None,
    };
    let start = &recording.summary().start;
    let last_ns = recording.summary().span_ns().map_or(0, |[_, last]| start.session_ns(last));
    let range = range.unwrap_or([0, last_ns]);
    let total: u64 = recording.summary().streams.iter().map(|stream| stream.totals.bytes).sum();
    let share = (range[1] - range[0]) as f64 / last_ns.max(1) as f64;
    let progress = terminal.progress("cutting");
    let mut lost = Vec::new();
    let totals = write_excerpt(recording, range, chosen.as_deref(), out, &mut lost, |bytes| {
        progress.update(bytes, ((total as f64 * share) as u64).max(bytes), "bytes");
    })?;
    drop(progress);
    let stream = |(id, totals): (&String, &erfgs_session::container::StreamTotals)| WrittenStream {
        stream: id.clone(),
        packets: totals.packets,
        bytes: totals.bytes,
    };
    let written = Written {
        file: out.clone(),
        bytes: std::fs::metadata(out).map_or(0, |metadata| metadata.len()),
        seconds: (range[1] - range[0]) as f64 * 1e-9,
        streams: totals.streams.iter().map(stream).collect(),
    };
    terminal.result(&written, || {
        let line = |stream: &WrittenStream| {
            format!("{}: {} packets, {}", stream.stream, thousands(stream.packets), bytes(stream.bytes))
        };
        let lines: Vec<String> = written.streams.iter().map(line).collect();
        format!("{}: {:.3} s, {}\n{}", out.display(), written.seconds, bytes(written.bytes), lines.join("\n"))
    })?;
    super::complain(recording, &lost)
}
