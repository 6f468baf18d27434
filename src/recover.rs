//! `erfgs recover`: repair a session whose recording was cut off.

use std::path::PathBuf;

use erfgs_session::container::{self, Recovered};
use serde::Serialize;

use crate::terminal::{Terminal, bytes, thousands};

/// Repair a session whose recording was cut off.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
What lies in whole chunks stays byte for byte; at most the last chunk (half a second) is lost. The session itself is left \
alone, and the copy gets the index that was never written. --in-place appends the index to the session itself, which \
needs next to no room on the disk; what it cuts off lies in S.mcap.before until the result was read back. A session can be read, \
replayed and exported without being repaired. Of a session that is whole no copy is written. What is damaged within (`erfgs info \
--check`) is left out of the copy, and told: the messages that cannot be read, chunks that come twice, and where a chunk's checksum \
does not say which of its messages is wrong, all of it. A single bit that flipped in a chunk that is not compressed is put right.

Exit codes: 0 repaired, or whole already; 1 nothing could be saved, or the copy could not be written.

Examples:
  erfgs recover S.mcap
  erfgs recover S.mcap --out whole.mcap
  erfgs recover S.mcap --in-place")]
pub struct Arguments {
    /// The session.
    session: PathBuf,
    /// The file to write, if there is something to repair; beside the session, named *.recovered.mcap, without it.
    #[arg(long, value_name = "FILE", conflicts_with = "in_place")]
    out: Option<PathBuf>,
    /// Repair the session itself.
    #[arg(long)]
    in_place: bool,
}

#[derive(Serialize)]
struct Report {
    /// The repaired file; absent if there was nothing to repair.
    file: Option<PathBuf>,
    was_whole: bool,
    messages: u64,
    chunks: u64,
    cut_bytes: u64,
    damaged: Vec<String>,
    mended: Vec<String>,
}

/// Repairs the session and says what was lost.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let out = match &arguments.out {
        Some(out) => out.clone(),
        None if arguments.in_place => arguments.session.clone(),
        None => arguments.session.with_extension("recovered.mcap"),
    };
    let Recovered { was_whole, messages, chunks, cut_bytes, damaged, mended } = if arguments.in_place {
        container::recover_in_place(&arguments.session)?
    } else {
        container::recover(&arguments.session, &out)?
    };
    let report = Report { file: (!was_whole).then_some(out), was_whole, messages, chunks, cut_bytes, damaged, mended };
    terminal.result(&report, || match &report.file {
        None if arguments.out.is_some() => format!(
            "{} is whole: nothing to repair, and no copy was written; `cp` makes one",
            arguments.session.display()
        ),
        None => format!("{} is whole: nothing to repair, nothing was written", arguments.session.display()),
        Some(file) => {
            let mut text = format!(
                "{}: {} messages in {} chunks; {} behind the last whole chunk are lost",
                file.display(),
                thousands(report.messages),
                thousands(report.chunks),
                bytes(report.cut_bytes)
            );
            for place in &report.mended {
                text.push_str("\nput right: ");
                text.push_str(place);
            }
            for place in &report.damaged {
                text.push_str("\nlost: ");
                text.push_str(place);
            }
            text
        }
    })
}
