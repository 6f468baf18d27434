//! The biases that event cameras were recorded with, as bias files of Metavision.

use std::path::PathBuf;

use erfgs_base::{FileError, atomic};
use erfgs_rig::event::BiasOffsets;
use erfgs_session::container::Recording;
use serde::Serialize;

use super::Task;
use crate::{errors::Usage, terminal::Terminal};

#[derive(Serialize)]
struct Exported {
    stream: String,
    file: PathBuf,
    biases: BiasOffsets,
}

/// Writes the files and lists them.
pub fn export(recording: &Recording, tasks: &[Task], terminal: &Terminal) -> anyhow::Result<()> {
    let streams = &recording.summary().streams;
    let with_biases = tasks.iter().filter_map(|task| {
        let biases = BiasOffsets::of_settings(&streams[task.stream].description.settings)?;
        Some(Exported { stream: task.id.clone(), file: task.out.clone(), biases })
    });
    let files: Vec<Exported> = with_biases.collect();
    if files.is_empty() {
        let tried: Vec<&str> = tasks.iter().map(|task| task.id.as_str()).collect();
        let what = format!("no biases of an IMX636 (EVK4) were recorded of {}", tried.join(", "));
        return Err(
            Usage(format!("{what} in {}; settings of other sensors: erfgs info", recording.path().display())).into()
        );
    }
    for Exported { file, biases, .. } in &files {
        let written = atomic::write(file, biases.to_metavision().as_bytes());
        written.map_err(FileError::when("write", file))?;
    }
    terminal.result(&files, || {
        let line = |exported: &Exported| format!("{}: biases of {}", exported.file.display(), exported.stream);
        files.iter().map(line).collect::<Vec<_>>().join("\n")
    })
}
