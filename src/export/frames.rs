//! The frames of a recording as pictures and videos.

use std::{
    collections::HashMap,
    fmt::Write,
    path::{Path, PathBuf},
};

use anyhow::Context;
use erfgs_base::atomic;
use erfgs_scene::pixel;
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    clock::EpochCursor,
    container::{Entry, Recording, SessionStart},
    source::{Description, Encoding, Packet},
};
use erfgs_sync::{StreamSync, Synchronisation};
use serde::Serialize;

use super::{Format, Task, events::is_passed_over, sensor_frames};
use crate::{
    render::{exr, video::Video},
    sync,
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
pub fn export(recording: &mut Recording, format: Format, tasks: &[Task], terminal: &Terminal) -> anyhow::Result<()> {
    let sync = sync::kept(recording.path(), recording.summary(), terminal)?;
    let (mut exported, mut lost) = (Vec::new(), Vec::new());
    for task in tasks {
        let mut writing = Writing::begin(recording, format, task, sync.as_ref());
        let total = recording.summary().streams[task.stream].totals;
        let progress = terminal.progress(&task.id);
        if recording.summary().streams[task.stream].description.encoding.has_sensor_frames() {
            sensor_frames::decode(recording, task, &mut writing, &mut lost, |bytes| {
                progress.update(bytes, total.bytes, "bytes");
            })?;
        } else {
            for entry in recording.messages(None) {
                match entry {
                    Ok(Entry::Packet { stream, packet }) if stream == task.stream => {
                        writing.push_packet(&packet)?;
                        progress.update(writing.exported.frames, total.packets, "frames");
                    }
                    Ok(_) => {}
                    Err(error) if is_passed_over(&error) => lost.push(error.to_string()),
                    Err(error) => return Err(error.into()),
                }
            }
        }
        exported.push(writing.finish()?);
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

/// The file with the times of the frames.
fn list_beside(out: &Path, is_folder: bool, is_of_sensor: bool) -> PathBuf {
    match (is_folder, is_of_sensor) {
        (true, _) => out.join("frames.csv"),
        // The name with `.csv` alone is that of the events.
        (false, true) => out.with_extension("frames.csv"),
        (false, false) => out.with_extension("csv"),
    }
}

/// A stream that is being written.
pub struct Writing<'a> {
    task: &'a Task,
    is_folder: bool,
    is_of_sensor: bool,
    out: Out,
    description: Description,
    start: SessionStart,
    sync: Option<&'a StreamSync>,
    mids: HashMap<u64, i64>,
    times: String,
    exported: Exported,
}

impl<'a> Writing<'a> {
    fn begin(recording: &Recording, format: Format, task: &'a Task, sync: Option<&'a Synchronisation>) -> Self {
        let summary = recording.summary();
        let recorded = &summary.streams[task.stream];
        let totals = recorded.totals;
        let span_ns =
            totals.first_host_ns.zip(totals.last_host_ns).map_or(0, |(first, last)| last.saturating_sub(first));
        let rate_hz =
            if span_ns > 0 { totals.packets.saturating_sub(1) as f64 / (span_ns as f64 * 1e-9) } else { 30.0 };
        let sync = sync.and_then(|sync| sync.stream(&task.id));
        let is_of_sensor = recorded.description.encoding.has_sensor_frames();
        Self {
            task,
            is_folder: format.is_folder(),
            is_of_sensor,
            out: match format {
                Format::Exr => Out::Exr,
                Format::Mp4 => Out::Mp4(None),
                _ => Out::Png,
            },
            description: recorded.description.clone(),
            start: summary.start.clone(),
            sync,
            mids: sync.map(StreamSync::exposure_mids).unwrap_or_default().into_iter().collect(),
            times: match is_of_sensor {
                true => "frame,exposure_start_us,exposure_end_us,exposure_mid_ns\n".to_owned(),
                false => "frame,sequence,arrival_ns,exposure_mid_ns\n".to_owned(),
            },
            exported: Exported { stream: task.id.clone(), path: task.out.clone(), frames: 0, damaged: 0, rate_hz },
        }
    }

    /// Takes this for the rate of the frames.
    pub fn set_rate(&mut self, rate_hz: f64) {
        self.exported.rate_hz = rate_hz;
    }

    /// Writes a frame of a camera.
    fn push_packet(&mut self, packet: &Packet) -> anyhow::Result<()> {
        let mid = self.mids.get(&packet.sequence).map_or(String::new(), |mid| mid.to_string());
        let times = format!("{},{},{mid}", packet.sequence, self.start.session_ns(packet.host_ns));
        self.push(&times, &packet.payload)
    }

    /// The clocks of the stream, if `erfgs sync` has fitted them.
    pub fn clocks(&self) -> Option<EpochCursor<'a>> {
        self.sync.map(|sync| sync.epochs.follow())
    }

    /// Writes a frame of an event sensor, which is exposed at these device times; the middle in session time, if it is known.
    pub fn push_exposed(
        &mut self,
        encoding: Encoding,
        [width, height]: [u16; 2],
        exposure_us: [u64; 2],
        mid_ns: Option<i64>,
        payload: &[u8],
    ) -> anyhow::Result<()> {
        let description = &mut self.description;
        (description.encoding, description.width, description.height) = (encoding, width.into(), height.into());
        description.settings.clear();
        let [start_us, end_us] = exposure_us;
        let mid = mid_ns.map_or(String::new(), |mid| mid.to_string());
        self.push(&format!("{start_us},{end_us},{mid}"), payload)
    }

    fn push(&mut self, times: &str, payload: &[u8]) -> anyhow::Result<()> {
        let out = &self.task.out;
        let index = self.exported.frames;
        if index == 0 {
            let folder = if self.is_folder { out.as_path() } else { out.parent().unwrap_or(Path::new(".")) };
            if !folder.as_os_str().is_empty() {
                std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
            }
        }
        if !self.out.push(out, index, &self.description, payload, self.exported.rate_hz)? {
            self.exported.damaged += 1;
            return Ok(());
        }
        let _ = writeln!(self.times, "{index},{times}");
        self.exported.frames += 1;
        Ok(())
    }

    fn finish(self) -> anyhow::Result<Exported> {
        if let Out::Mp4(Some(video)) = self.out {
            video.finish()?;
        }
        if self.exported.frames > 0 {
            let out = &self.task.out;
            let list = list_beside(out, self.is_folder, self.is_of_sensor);
            atomic::write(&list, self.times.as_bytes()).with_context(|| format!("cannot write {}", list.display()))?;
        }
        Ok(self.exported)
    }
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
        let Some(format) = description.frame_format() else { return Ok(false) };
        let is_deep = pixel::is_deep(format.pixels);
        match self {
            Self::Png if is_deep => {
                let Ok(image) = format.deep_picture(payload) else { return Ok(false) };
                image.write_png(&file("png"))?;
            }
            Self::Png => {
                let Ok(image) = format.picture(payload) else { return Ok(false) };
                image.write_png(&file("png"))?;
            }
            Self::Exr if is_deep || matches!(format.pixels, PixelFormat::Bayer(..)) => {
                let Ok(light) = format.light(payload) else { return Ok(false) };
                exr::write_light(&file("exr"), &light)?;
            }
            Self::Exr => {
                let Ok(image) = format.picture(payload) else { return Ok(false) };
                exr::write_rgb8(&file("exr"), &image)?;
            }
            Self::Mp4(video) => {
                let Ok(image) = format.picture(payload) else { return Ok(false) };
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
