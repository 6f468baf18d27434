//! `erfgs import PLAN.toml` and `erfgs import FOLDER`: the files of several cameras as one session.

use std::path::{Path, PathBuf};

use erfgs_base::FileError;
use erfgs_bridge::import::{self, ImportedSession, Plan};
use serde::Serialize;

use crate::{
    errors::Usage,
    export::complain_of_damage,
    terminal::{Terminal, bytes, table, thousands},
};

/// The plan that is drafted in a folder.
const PLAN: &str = "import.toml";

#[derive(Serialize)]
struct Stream {
    id: String,
    encoding: String,
    width: u32,
    height: u32,
    packets: u64,
    bytes: u64,
    starts_s: f64,
}

#[derive(Serialize)]
struct Imported {
    file: PathBuf,
    streams: Vec<Stream>,
}

impl Imported {
    fn of(file: &Path, imported: &ImportedSession) -> Self {
        let stream = |stream: &import::ImportedStream| Stream {
            id: stream.description.id.clone(),
            encoding: stream.description.encoding.to_string(),
            width: stream.description.width,
            height: stream.description.height,
            packets: stream.totals.packets,
            bytes: stream.totals.bytes,
            starts_s: stream.starts_ns as f64 * 1e-9,
        };
        Self { file: file.to_owned(), streams: imported.streams.iter().map(stream).collect() }
    }

    fn describe(&self) -> String {
        let head = ["stream", "encoding", "size", "packets", "bytes", "from, s"].map(str::to_owned).to_vec();
        let row = |stream: &Stream| {
            vec![
                stream.id.clone(),
                stream.encoding.clone(),
                format!("{}x{}", stream.width, stream.height),
                thousands(stream.packets),
                bytes(stream.bytes),
                format!("{:.6}", stream.starts_s),
            ]
        };
        let rows: Vec<_> = std::iter::once(head).chain(self.streams.iter().map(row)).collect();
        let file = self.file.display();
        format!("{}\n{file}; what its times are worth: erfgs sync {file}", table(&rows))
    }
}

/// Writes the session of a plan.
pub fn run(plan: &Path, out: Option<&Path>, terminal: &Terminal) -> anyhow::Result<()> {
    let out = out.map_or_else(|| plan.with_extension("mcap"), Path::to_owned);
    super::check_out(&out)?;
    let loaded = Plan::load(plan)?;
    let bar = terminal.progress("importing");
    let imported = import::import(&loaded, &out, &mut |step| bar.update(step.done, step.total, step.what))?;
    drop(bar);
    let told = Imported::of(&out, &imported);
    terminal.result(&told, || told.describe())?;
    complain_of_damage("imported", plan, &imported.damage)
}

#[derive(Serialize)]
struct Drafted {
    plan: PathBuf,
    events: usize,
    frames: usize,
    left_out: Vec<String>,
}

/// Drafts the plan of a folder.
pub fn draft(folder: &Path, terminal: &Terminal) -> anyhow::Result<()> {
    let plan = folder.join(PLAN);
    if plan.exists() {
        let plan = plan.display();
        return Err(Usage(format!(
            "{plan} exists already: import it (erfgs import {plan}), or remove it for a new draft"
        ))
        .into());
    }
    let bar = terminal.progress("looking at files");
    let draft = import::draft(folder, &mut |done, total| bar.update(done, total, "files"))?;
    drop(bar);
    if draft.events + draft.frames == 0 {
        let (folder, left_out) = (folder.display(), draft.left_out.join("; "));
        let what = if left_out.is_empty() { String::new() } else { format!(" ({left_out})") };
        return Err(
            Usage(format!("there is no event file, no video and no folder of pictures in {folder}{what}")).into()
        );
    }
    erfgs_base::atomic::write(&plan, draft.text.as_bytes()).map_err(FileError::when("write", &plan))?;
    let (events, frames, left_out) = (draft.events, draft.frames, draft.left_out);
    let drafted = Drafted { plan, events, frames, left_out };
    terminal.result(&drafted, || {
        let plan = drafted.plan.display();
        format!(
            "{plan}: event files {events}, streams of frames {frames}, left out {}\ncomplete it where it says when, then: erfgs import \
             {plan} --out take.mcap",
            drafted.left_out.len()
        )
    })
}
