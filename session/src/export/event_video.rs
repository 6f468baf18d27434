//! The events of a stream as a video.

use std::path::Path;

use erfgs_events::{ApsFrame, CdEvent, Sink};
use erfgs_scene::video::VideoWriter;

use super::ExportError;
use crate::{
    EventPicture,
    container::{Recording, sensor_size},
};

/// Where nothing happens for longer than this, seconds of the video, the rest is left out.
const STILL_S: f64 = 30.0;

/// How events become a video.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EventVideo {
    /// Pictures a second of the video; above 0.
    pub fps: f64,
    /// How many times as fast as it happened the video plays: 0.01 is a hundred times slower; above 0.
    pub speed: f64,
    /// Each picture shows the events of so many microseconds; where it is not given, of the time from picture to picture,
    /// so that every event is seen, and in one picture.
    pub span_us: Option<u64>,
}

impl Default for EventVideo {
    fn default() -> Self {
        Self { fps: 30.0, speed: 1.0, span_us: None }
    }
}

impl EventVideo {
    /// From picture to picture, microseconds of the recording.
    fn step_us(&self) -> f64 {
        (1e6 * self.speed / self.fps).clamp(1.0, 1e12)
    }
}

/// What became of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrittenVideo {
    /// Pictures in the video.
    pub frames: u64,
    /// Events that they show.
    pub events: u64,
    /// Device time of the first picture, and from each to the next, microseconds.
    pub first_us: u64,
    /// See there.
    pub step_us: f64,
    /// Times without events, and leaps of the device's clock, that were left out.
    pub left_out: u64,
}

/// Writes the events of the stream `id` as an H.264 video at `path`, by ffmpeg, over the sensor's own frames where it has
/// them. A stream without an event leaves nothing behind. What was lost to damage of the recording is added to `damage`; `progress` is called with the bytes of payload.
///
/// # Errors
/// If the recording has no such stream or cannot be read, if it has no events, or if the video cannot be written.
pub fn write_event_video(
    recording: &mut Recording,
    id: &str,
    video: EventVideo,
    path: &Path,
    damage: &mut Vec<String>,
    progress: impl FnMut(u64),
) -> Result<WrittenVideo, ExportError> {
    let (stream, recorded) = recording.stream(id)?;
    let no_events = || ExportError::NoEvents { id: id.to_owned() };
    let size = sensor_size(&recorded.description).ok_or_else(no_events)?;
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(ExportError::writing(folder))?;
    }
    let step_us = video.step_us();
    let mut film = Film {
        picture: EventPicture::new(size),
        video,
        step_us,
        path,
        out: None,
        due: None,
        written: WrittenVideo { frames: 0, events: 0, first_us: 0, step_us, left_out: 0 },
        error: None,
    };
    let decoded = recording.decode_events(stream, &mut film, progress)?.ok_or_else(no_events)?;
    damage.extend(decoded.damage);
    film.finish()
}

/// The video that is being written; the first error ends the writing.
struct Film<'a> {
    picture: EventPicture,
    video: EventVideo,
    step_us: f64,
    path: &'a Path,
    out: Option<VideoWriter>,
    /// Device time of the first picture since the last break, microseconds, and how many there were since.
    due: Option<(u64, u64)>,
    written: WrittenVideo,
    error: Option<ExportError>,
}

impl Film<'_> {
    /// Device time of the next picture.
    fn next_us(&self) -> Option<u64> {
        let (first_us, count) = self.due?;
        Some(first_us.saturating_add((count as f64 * self.step_us) as u64))
    }

    /// Something happens at `t_us`: the pictures before it are made.
    fn advance(&mut self, t_us: u64) {
        let Some(next_us) = self.next_us() else {
            let first_us = t_us.saturating_add(self.step_us as u64);
            if self.written.frames == 0 {
                self.written.first_us = first_us;
            }
            self.due = Some((first_us, 0));
            return;
        };
        if t_us <= next_us || self.error.is_some() {
            return;
        }
        let still = (STILL_S * self.video.fps).max(1.0) as u64;
        let mut drawn = 0;
        while drawn < still && self.next_us().is_some_and(|next_us| t_us > next_us) {
            self.draw();
            drawn += 1;
        }
        if self.next_us().is_some_and(|next_us| t_us > next_us) {
            self.written.left_out += 1;
            self.due = None;
            self.advance(t_us);
        }
    }

    fn draw(&mut self) {
        let Some(now_us) = self.next_us() else { return };
        if let Some((_, count)) = &mut self.due {
            *count += 1;
        }
        if self.error.is_none()
            && let Err(error) = self.push(now_us)
        {
            self.error = Some(error);
        }
    }

    fn push(&mut self, now_us: u64) -> Result<(), ExportError> {
        let out = match &mut self.out {
            Some(out) => out,
            none => {
                let [width, height] = self.picture.size();
                none.insert(VideoWriter::create(self.path, width, height, self.video.fps)?)
            }
        };
        let span_us = self.video.span_us.unwrap_or(self.step_us.ceil() as u64).max(1);
        out.push(&self.picture.render(now_us, span_us.saturating_sub(1), 1))?;
        self.written.frames += 1;
        Ok(())
    }

    /// Makes the last picture.
    fn finish(mut self) -> Result<WrittenVideo, ExportError> {
        if self.picture.events() > 0 {
            self.draw();
        }
        if let Some(error) = self.error {
            return Err(error);
        }
        self.written.events = self.picture.events();
        if let Some(out) = self.out {
            out.finish()?;
        }
        Ok(self.written)
    }
}

impl Sink for Film<'_> {
    fn event(&mut self, event: CdEvent) {
        self.advance(event.t_us);
        self.picture.event(event);
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.picture.frame(frame);
    }

    fn discontinuity(&mut self, _t_us: u64) {
        if self.picture.newest_us().is_some() {
            self.draw();
            self.written.left_out += 1;
        }
        self.due = None;
        self.picture.clear();
    }
}
