//! The frames of a session as pictures and videos.

use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

use anyhow::Context;
use erfgs_rig::sync::{StreamSync, Synchronisation};
use erfgs_session::{
    atomic,
    container::{ContainerError, Entry, Session},
    pixel,
    source::{Description, Encoding},
};
use serde::Serialize;

use super::{Format, Task};
use crate::{
    render::{exr, video::Video},
    terminal::Terminal,
};

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

/// Where frames go.
enum Out {
    Png,
    Exr,
    Mp4(Option<Video>),
}

/// Writes the streams and lists them.
pub fn export(session: &mut Session, format: Format, tasks: &[Task], terminal: &Terminal) -> anyhow::Result<()> {
    let beside = Synchronisation::file_beside(session.path());
    let sync = if beside.is_file() { Some(Synchronisation::load(&beside)?) } else { None };
    let mut exported = Vec::new();
    for task in tasks {
        exported.push(stream(session, format, task, sync.as_ref(), terminal)?);
    }
    terminal.result(&exported, || {
        let line = |stream: &Exported| {
            let damaged =
                if stream.damaged > 0 { format!("; {} did not decode", stream.damaged) } else { String::new() };
            format!("{}: {} frames, {:.3} a second{damaged}", stream.path.display(), stream.frames, stream.rate_hz)
        };
        exported.iter().map(line).collect::<Vec<_>>().join("\n")
    })
}

fn stream(
    session: &mut Session,
    format: Format,
    task: &Task,
    sync: Option<&Synchronisation>,
    terminal: &Terminal,
) -> anyhow::Result<Exported> {
    let recorded = &session.summary().streams[task.stream];
    let (description, totals) = (recorded.description.clone(), recorded.totals);
    let start = session.summary().start.clone();
    let span_ns = totals.first_host_ns.zip(totals.last_host_ns).map_or(0, |(first, last)| last.saturating_sub(first));
    let rate_hz = if span_ns > 0 { totals.packets.saturating_sub(1) as f64 / (span_ns as f64 * 1e-9) } else { 30.0 };
    let mids = sync.and_then(|sync| sync.stream(&task.id)).map(StreamSync::exposure_mids).unwrap_or_default();
    let mut out = match format {
        Format::Exr => Out::Exr,
        Format::Mp4 => Out::Mp4(None),
        _ => Out::Png,
    };
    let folder = if format.is_folder() { task.out.as_path() } else { task.out.parent().unwrap_or(Path::new(".")) };
    if !folder.as_os_str().is_empty() {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let mut times = String::from("frame,sequence,arrival_ns,exposure_mid_ns\n");
    let mut exported = Exported { stream: task.id.clone(), path: task.out.clone(), frames: 0, damaged: 0, rate_hz };
    let progress = terminal.progress(&task.id);
    for entry in session.messages(None) {
        let packet = match entry {
            Ok(Entry::Packet { stream, packet }) if stream == task.stream => packet,
            Err(error @ ContainerError::Read { .. }) => return Err(error.into()),
            _ => continue,
        };
        let index = exported.frames;
        if !out.push(&task.out, index, &description, &packet.payload, rate_hz)? {
            exported.damaged += 1;
            continue;
        }
        let mid = mids.get(&packet.sequence).map_or(String::new(), |mid| mid.to_string());
        let _ = writeln!(times, "{index},{},{},{mid}", packet.sequence, start.session_ns(packet.host_ns));
        exported.frames += 1;
        progress.update(index + 1, totals.packets, "frames");
    }
    if let Out::Mp4(Some(video)) = out {
        video.finish()?;
    }
    let list = if format.is_folder() { folder.join("frames.csv") } else { task.out.with_extension("csv") };
    atomic::write(&list, times.as_bytes()).with_context(|| format!("cannot write {}", list.display()))?;
    Ok(exported)
}

impl Out {
    /// Decodes a frame and writes it, with all the bits that the format and the frame have; `false` if it does not decode.
    fn push(
        &mut self,
        path: &Path,
        index: u64,
        description: &Description,
        payload: &[u8],
        rate_hz: f64,
    ) -> anyhow::Result<bool> {
        let file = |extension: &str| path.join(format!("{index:06}.{extension}"));
        let is_deep = pixel::is_deep(description.encoding);
        match self {
            Self::Png if is_deep => {
                let Ok(image) = pixel::deep_picture(description, payload) else { return Ok(false) };
                image.write_png(&file("png"))?;
            }
            Self::Png => {
                let Ok(image) = pixel::picture(description, payload) else { return Ok(false) };
                image.write_png(&file("png"))?;
            }
            Self::Exr if is_deep || matches!(description.encoding, Encoding::Bayer(..)) => {
                let Ok(light) = pixel::light(description, payload) else { return Ok(false) };
                exr::write_light(&file("exr"), &light)?;
            }
            Self::Exr => {
                let Ok(image) = pixel::picture(description, payload) else { return Ok(false) };
                exr::write_rgb8(&file("exr"), &image)?;
            }
            Self::Mp4(video) => {
                let Ok(image) = pixel::picture(description, payload) else { return Ok(false) };
                if video.is_none() {
                    *video = Some(Video::create(path, image.width, image.height, rate_hz)?);
                }
                if let Some(video) = video {
                    video.push(&image.data)?;
                }
            }
        }
        Ok(true)
    }
}
