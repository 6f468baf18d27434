//! The frames of a recording as pictures and videos.

use std::path::PathBuf;

use erfgs_session::{
    container::Recording,
    export::{Exposures, FramesFormat, write_frames},
};
use serde::Serialize;

use super::Task;
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

/// Writes the streams and lists them.
pub fn export(
    recording: &mut Recording,
    format: FramesFormat,
    tasks: &[Task],
    terminal: &Terminal,
) -> anyhow::Result<()> {
    let sync = sync::kept(recording.path(), recording.summary(), terminal)?;
    let (mut exported, mut lost) = (Vec::new(), Vec::new());
    for task in tasks {
        let recorded = &recording.summary().streams[task.stream];
        let (total, unit) = match recorded.description.encoding.has_sensor_frames() {
            true => (recorded.totals.bytes, "bytes"),
            false => (recorded.totals.packets, "frames"),
        };
        let progress = terminal.progress(&task.id);
        let update = |done: u64| progress.update(done, total, unit);
        let stream = sync.as_ref().and_then(|sync| sync.stream(&task.id));
        let exposures = stream.map(|sync| Exposures { mids: sync.exposure_mids(), epochs: &sync.epochs });
        let written = write_frames(recording, &task.id, format, &task.out, exposures.as_ref(), &mut lost, update)?;
        exported.push(Exported {
            stream: task.id.clone(),
            path: task.out.clone(),
            frames: written.frames,
            damaged: written.damaged,
            rate_hz: written.rate_hz,
        });
    }
    // An event camera that made no pictures is no failure, unless there is nothing else.
    if exported.iter().all(|stream| stream.frames + stream.damaged == 0) {
        anyhow::bail!("{} has no frames", recording.path().display());
    }
    terminal.result(&exported, || {
        let line = |stream: &Exported| {
            let damaged =
                if stream.damaged > 0 { format!("; {} did not decode", stream.damaged) } else { String::new() };
            format!("{}: {} frames, {:.3} a second{damaged}", stream.path.display(), stream.frames, stream.rate_hz)
        };
        exported.iter().map(line).collect::<Vec<_>>().join("\n")
    })?;
    super::complain(recording, &lost)
}
