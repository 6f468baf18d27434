//! `erfgs merge`: the sessions of several hosts, one trigger board, one session.

use std::path::{Path, PathBuf};

use erfgs_session::{
    Session,
    container::{Merged, Part, merge},
};
use erfgs_sync::{Aligned, Pulses};
use serde::Serialize;

use crate::{
    errors::{Usage, recording_at},
    terminal::{Terminal, bytes, table, thousands},
};

/// Merge the sessions that several hosts recorded with one trigger board.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The hosts' clocks need not agree: the trigger board's pulses are numbered, and a pulse that two hosts recorded is the same \
moment. Each session needs the board's lines, or an event camera whose trigger input sees the pulses. Packets are kept byte \
for byte; host times are converted to those of the host with the board. Streams of the same name get the name of their file \
as a prefix. A session that was cut off is merged up to its end. Sessions without common pulses are refused.

Examples:
  erfgs merge left.mcap right.mcap --out take1.mcap
  erfgs sync take1.mcap")]
pub struct Arguments {
    /// The sessions.
    #[arg(required = true, num_args = 2.., value_name = "S.mcap")]
    sessions: Vec<PathBuf>,
    /// The session to write.
    #[arg(long, value_name = "S.mcap")]
    out: PathBuf,
    /// Ignore the hosts' dates. By default sessions whose dates are more than 30 s apart are refused.
    #[arg(long)]
    any_date: bool,
}

#[derive(Serialize)]
struct Summary {
    out: PathBuf,
    bytes: u64,
    reference: PathBuf,
    sessions: Vec<SessionRow>,
    streams: Vec<StreamRow>,
    cut_off: Vec<PathBuf>,
    damaged: Vec<String>,
}

#[derive(Serialize)]
struct SessionRow {
    session: PathBuf,
    /// The stream that told the pulses.
    by: String,
    pulses: usize,
    /// Pulses that the session and the reference know.
    common: usize,
    /// What its host's clock is slower, parts per million.
    rate_ppm: f64,
    /// How far 95 of 100 pulses are off at most, microseconds.
    p95_us: f64,
    /// What its calendar is ahead, seconds.
    calendar_s: f64,
}

#[derive(Serialize)]
struct StreamRow {
    stream: String,
    session: PathBuf,
    id: String,
    packets: u64,
}

/// Aligns and merges.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    for session in &arguments.sessions {
        recording_at(session)?;
    }
    if arguments.out.extension().is_none_or(|extension| extension != "mcap") {
        return Err(Usage(format!("'{}' names no session: sessions end in .mcap", arguments.out.display())).into());
    }
    let mut sessions = arguments.sessions.iter().map(|path| Session::open(path)).collect::<Result<Vec<_>, _>>()?;
    let total: u64 =
        sessions.iter().flat_map(|session| &session.summary().streams).map(|stream| stream.totals.bytes).sum();
    let reading = terminal.progress("reading the pulses");
    let mut pulses = Vec::new();
    let mut before = 0;
    for session in &mut sessions {
        pulses.push(Pulses::of(session, |bytes| reading.update(before + bytes, total, "bytes"))?);
        before += session.summary().streams.iter().map(|stream| stream.totals.bytes).sum::<u64>();
    }
    drop(reading);
    let reference = Pulses::reference(&pulses)?;
    let aligned =
        pulses.iter().map(|own| own.align(&pulses[reference], arguments.any_date)).collect::<Result<Vec<_>, _>>()?;
    let to_host: Vec<Box<dyn Fn(i64) -> i64>> =
        aligned.iter().zip(&pulses).map(|(aligned, own)| aligned.to_host_ns(own, &pulses[reference])).collect();
    // The reference comes first: its clock is the one of the merged session.
    let mut parts: Vec<Part<'_, _>> =
        sessions.iter_mut().zip(&to_host).map(|(session, host_ns)| Part { session, host_ns: &**host_ns }).collect();
    parts[..=reference].rotate_right(1);
    let writing = terminal.progress("merging");
    let merged = merge(&mut parts, &arguments.out, |bytes| writing.update(bytes, total, "bytes"))?;
    drop(writing);
    let summary = summary(&arguments.out, &pulses, &aligned, reference, merged);
    terminal.result(&summary, || describe(&summary))
}

fn summary(out: &Path, pulses: &[Pulses], aligned: &[Aligned], reference: usize, merged: Merged) -> Summary {
    let session = |(own, aligned): (&Pulses, &Aligned)| SessionRow {
        session: own.path.clone(),
        by: own.stream.clone(),
        pulses: own.rises_ns.len(),
        common: aligned.common,
        rate_ppm: aligned.clock.rate_error_ppm(),
        p95_us: aligned.clock.residuals.p95_ns * 1e-3,
        calendar_s: aligned.calendar_ns as f64 * 1e-9,
    };
    let Merged { streams, bytes, cut_off, damaged } = merged;
    Summary {
        out: out.to_owned(),
        bytes,
        reference: pulses[reference].path.clone(),
        sessions: pulses.iter().zip(aligned).map(session).collect(),
        streams: streams
            .into_iter()
            .map(|row| StreamRow { stream: row.merged_id, session: row.from, id: row.id, packets: row.packets })
            .collect(),
        cut_off,
        damaged,
    }
}

fn describe(summary: &Summary) -> String {
    let heading = ["session", "pulses by", "pulses", "in common", "rate, ppm", "off, µs", "calendar, s"];
    let mut rows = vec![heading.map(String::from).to_vec()];
    rows.extend(summary.sessions.iter().map(|row| {
        vec![
            row.session.display().to_string(),
            row.by.clone(),
            thousands(row.pulses as u64),
            thousands(row.common as u64),
            format!("{:.2}", row.rate_ppm),
            format!("{:.0}", row.p95_us),
            format!("{:.3}", row.calendar_s),
        ]
    }));
    let mut text = table(&rows);
    let mut rows = vec![["stream", "of", "there", "packets"].map(String::from).to_vec()];
    rows.extend(summary.streams.iter().map(|row| {
        vec![row.stream.clone(), row.session.display().to_string(), row.id.clone(), thousands(row.packets)]
    }));
    text.push_str(&format!("\n{}", table(&rows)));
    for path in &summary.cut_off {
        text.push_str(&format!("{} was cut off: its streams end before the others\n", path.display()));
    }
    for place in &summary.damaged {
        text.push_str(&format!("lost: {place}\n"));
    }
    text.push_str(&format!(
        "\n{} ({}), on the clock of {}\n",
        summary.out.display(),
        bytes(summary.bytes),
        summary.reference.display()
    ));
    text
}
