//! `erfgs recover`: repair a session whose recording was cut off.

use std::path::{Path, PathBuf};

use erfgs_session::{
    Session,
    container::{self, ContainerError, Recovered},
};
use serde::Serialize;

use crate::errors::Usage;
use crate::terminal::{Terminal, bytes, thousands};

/// Repair a session whose recording was cut off.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Whole chunks are kept byte for byte; at most the last chunk (half a second) is lost. The session itself is not changed; the \
copy gets the missing index. --in-place appends the index to the session itself, which needs almost no disk space; what it \
cuts off is kept in S.mcap.before until the result has been verified. An unrepaired session can be read, replayed and \
exported, too. A whole session is not copied. Damage inside the session (`erfgs info --check`) is left out of the copy and \
reported: unreadable messages, duplicate chunks, and whole chunks whose checksum fails without showing which message is \
wrong. A single flipped bit in an uncompressed chunk is corrected.

Of a session in several files (`erfgs record --split`), --in-place repairs all; name one of the later files to repair it alone.

Exit codes: 0 repaired, or whole already; 1 nothing could be saved, or the copy could not be written.

Examples:
  erfgs recover S.mcap
  erfgs recover S.mcap --out whole.mcap
  erfgs recover S.mcap --in-place")]
pub struct Arguments {
    /// The session; of one in several files the first.
    session: PathBuf,
    /// The file to write, if there is something to repair. Default: beside the session, named *.recovered.mcap.
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
    let files = files(&arguments.session)?;
    if files.len() > 1 && !arguments.in_place && arguments.out.is_none() {
        let path = arguments.session.display();
        let what = format!(
            "{path} is a session in {} files: `erfgs recover {path} --in-place` repairs them where they lie; --out FILE copies this \
             one alone",
            files.len()
        );
        return Err(Usage(what).into());
    }
    let out = match &arguments.out {
        Some(out) => out.clone(),
        None if arguments.in_place => arguments.session.clone(),
        None => arguments.session.with_extension("recovered.mcap"),
    };
    let Recovered { was_whole, messages, chunks, cut_bytes, damaged, mended } = if arguments.in_place {
        let mut all = Recovered { was_whole: true, ..Recovered::default() };
        for file in &files {
            add(&mut all, container::recover_in_place(file)?);
        }
        all
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

/// The files that a session is in, those with anything in them.
fn files(first: &Path) -> Result<Vec<PathBuf>, ContainerError> {
    if container::parts_beside(first).is_ok_and(|parts| !parts.is_empty()) {
        // What cannot be opened may be repaired, but for parts that do not belong together.
        match Session::open(first) {
            Ok(session) if session.summary().files.len() > 1 => {
                let files = session.summary().files.iter().filter(|file| file.complete || file.whole_bytes > 0);
                return Ok(files.map(|file| file.path.clone()).collect());
            }
            Err(error @ (ContainerError::MissingPart { .. } | ContainerError::ForeignPart { .. })) => {
                return Err(error);
            }
            Ok(_) | Err(_) => {}
        }
    }
    Ok(vec![first.to_owned()])
}

fn add(all: &mut Recovered, of_file: Recovered) {
    let Recovered { was_whole, messages, chunks, cut_bytes, damaged, mended } = of_file;
    all.was_whole &= was_whole;
    all.messages += messages;
    all.chunks += chunks;
    all.cut_bytes += cut_bytes;
    all.damaged.extend(damaged);
    all.mended.extend(mended);
}
