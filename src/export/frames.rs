//! The frames of a recording as pictures and videos.

use std::path::PathBuf;

use erfgs_session::{
    container::Recording,
    export::{Exposures, FramesChoice, FramesFormat, write_frames},
};
use serde::Serialize;

use super::{StreamExport, Task};
use crate::{sync, terminal::Terminal};

#[derive(Serialize)]
struct Exported {
    stream: String,
    path: PathBuf,
    frames: u64,
    /// Frames that do not decode: cut or damaged.
    damaged: u64,
    /// Mean frames a second.
    rate_hz: f64,
}

/// Writes the streams, and what is to be exports of each; `bits` of samples of 16 count, where that is said.
pub fn export(
    recording: &mut Recording,
    (format, bits): (FramesFormat, Option<u8>),
    tasks: &[Task],
    lost: &mut Vec<String>,
    terminal: &Terminal,
) -> anyhow::Result<Vec<StreamExport>> {
    let sync = sync::kept(recording.path(), recording.summary(), terminal)?;
    let mut exports = Vec::new();
    for task in tasks {
        let recorded = &recording.summary().streams[task.stream];
        let (total, unit) = match recorded.description.encoding.has_sensor_frames() {
            true => (recorded.totals.bytes, "bytes"),
            false => (recorded.totals.packets, "frames"),
        };
        let progress = terminal.progress(&task.id);
        let update = |done: u64| progress.update(done, total, unit);
        let stream = sync.as_ref().and_then(|sync| sync.stream(&task.id));
        let exposures = stream.map(|sync| Exposures { frames: sync.frames(), epochs: &sync.epochs });
        let choice = FramesChoice { format, exposures: exposures.as_ref(), bits };
        let written = write_frames(recording, &task.id, choice, &task.out, lost, update)?;
        let damaged = if written.damaged > 0 { format!("; {} did not decode", written.damaged) } else { String::new() };
        let line =
            format!("{}: {} frames, {:.3} a second{damaged}", task.out.display(), written.frames, written.rate_hz);
        let exported = Exported {
            stream: task.id.clone(),
            path: task.out.clone(),
            frames: written.frames,
            damaged: written.damaged,
            rate_hz: written.rate_hz,
        };
        let is_empty = written.frames + written.damaged == 0;
        exports.push(StreamExport { exported: serde_json::to_value(exported)?, is_empty, line });
    }
    Ok(exports)
}
