//! Folders of pictures and videos as streams of frames.

use std::path::{Path, PathBuf};

use bytes::Bytes;
use erfgs_base::FileError;
use erfgs_scene::{
    ImageRgb8,
    image::{self, pictures},
    pixel::PixelFormat,
    video::Video,
};
use erfgs_session::source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint};
use serde_json::json;

use super::{
    PlanError,
    events::EventStream,
    plan::{Begin, Frames, Plan},
    times::Times,
};

/// A stream of frames, and when they were taken.
pub(super) struct FrameStream {
    pub description: Description,
    path: PathBuf,
    from: From,
    times: Times,
    /// When the first frame was over, nanoseconds of session time.
    pub starts_ns: i64,
    next: u64,
}

enum From {
    /// JPEG files, whose bytes are taken as they are.
    Jpeg(Vec<PathBuf>),
    /// Pictures that are decoded.
    Pictures(Vec<PathBuf>),
    /// A video, with its first frame, which told its size.
    Video { video: Box<Video>, first: Option<ImageRgb8> },
}

fn is_jpeg(path: &Path) -> bool {
    path.extension().is_some_and(|extension| !extension.eq_ignore_ascii_case("png"))
}

impl FrameStream {
    /// Opens the frames of a stream of a plan.
    pub fn open(plan: &Plan, frames: &Frames, events: &mut [EventStream]) -> Result<Self, PlanError> {
        let id = &frames.id;
        let of_image = |source| PlanError::Image { id: id.clone(), source };
        let of_video = |source| PlanError::Video { id: id.clone(), source };
        let path =
            plan.folder.join(frames.video.as_ref().or(frames.folder.as_ref()).map_or(PathBuf::new(), Clone::clone));
        let empty = || PlanError::File { id: id.clone(), path: path.clone(), what: "there is no frame in it".into() };
        let (from, first, count) = if frames.video.is_some() {
            let mut video = Video::open(&path).map_err(of_video)?;
            let first = video.next_frame().map_err(of_video)?.ok_or_else(empty)?;
            let size = [first.width, first.height];
            let count = Video::probe(&path).map(|probe| probe.frames);
            (From::Video { video: Box::new(video), first: Some(first) }, size, count)
        } else {
            let found = pictures(&path).map_err(of_image)?;
            let first = ImageRgb8::read(found.first().ok_or_else(empty)?).map_err(of_image)?;
            let count = found.len() as u64;
            let from = if found.iter().all(|path| is_jpeg(path)) { From::Jpeg(found) } else { From::Pictures(found) };
            (from, [first.width, first.height], Some(count))
        };
        let times = Times::of(frames, &plan.folder, count, events)?;
        let wrong = |what: String| PlanError::File { id: id.clone(), path: path.clone(), what };
        if let (Some(count), Some(times)) = (count, times.count())
            && count != times
        {
            return Err(wrong(format!("it has {count} frames, and there are times for {times}")));
        }
        let starts_ns =
            times.exposure(0).ok_or_else(|| wrong("there are no times for its frames".into()))?.span_ns()[1];
        let pixels = if matches!(from, From::Jpeg(_)) { PixelFormat::Mjpeg } else { PixelFormat::Rgb8 };
        let [width, height] = first;
        let description = Description {
            id: id.clone(),
            model: format!("imported from {}", path.file_name().unwrap_or_default().to_string_lossy()),
            serial: String::new(),
            encoding: Encoding::Frames(pixels),
            width,
            height,
            start_order: 0,
            settings: settings(frames),
        };
        Ok(Self { description, path, from, times, starts_ns, next: 0 })
    }

    /// How many frames there are, where that is known.
    pub fn count(&self) -> Option<u64> {
        match &self.from {
            From::Jpeg(files) | From::Pictures(files) => Some(files.len() as u64),
            From::Video { .. } => self.times.count(),
        }
    }

    fn wrong(&self, what: String) -> PlanError {
        PlanError::File { id: self.description.id.clone(), path: self.path.clone(), what }
    }

    /// The next frame's bytes.
    fn payload(&mut self) -> Result<Option<Bytes>, PlanError> {
        let id = &self.description.id;
        let of_image = |source| PlanError::Image { id: id.clone(), source };
        let at = usize::try_from(self.next).unwrap_or(usize::MAX);
        let (size, bytes) = match &mut self.from {
            From::Jpeg(files) => {
                let Some(path) = files.get(at) else { return Ok(None) };
                (image::size(path).map_err(of_image)?, std::fs::read(path).map_err(FileError::when("read", path))?)
            }
            From::Pictures(files) => {
                let Some(path) = files.get(at) else { return Ok(None) };
                let picture = ImageRgb8::read(path).map_err(of_image)?;
                ([picture.width, picture.height], picture.data)
            }
            From::Video { video, first } => {
                let next = match first.take() {
                    Some(first) => Some(first),
                    None => video.next_frame().map_err(|source| PlanError::Video { id: id.clone(), source })?,
                };
                let Some(picture) = next else { return Ok(None) };
                ([picture.width, picture.height], picture.data)
            }
        };
        let [width, height] = [self.description.width, self.description.height];
        if size != [width, height] {
            let what = format!("frame {at} has {} x {} pixels, and the first {width} x {height}", size[0], size[1]);
            return Err(self.wrong(what));
        }
        Ok(Some(bytes.into()))
    }

    /// The next frame; none after the last.
    pub fn packet(&mut self) -> Result<Option<Packet>, PlanError> {
        let Some(payload) = self.payload()? else {
            return match self.times.count() {
                Some(count) if count != self.next => {
                    Err(self.wrong(format!("it has {} frames, and there are times for {count}", self.next)))
                }
                _ => Ok(None),
            };
        };
        let sequence = self.next;
        let Some(exposure) = self.times.exposure(sequence) else {
            return Err(self.wrong(format!("it has more frames than there are times, which are {sequence}")));
        };
        self.next += 1;
        let kernel_ns = exposure.span_ns()[1];
        let stamp = FrameStamp {
            kernel_ns,
            clock: StampClock::Monotonic,
            point: StampPoint::EndOfFrame,
            sequence: sequence as u32,
        };
        Ok(Some(Packet {
            sequence,
            host_ns: kernel_ns,
            discontinuity: false,
            damaged: false,
            stamp: Some(stamp),
            payload,
        }))
    }
}

/// What synchronisation is to know of the frames.
fn settings(frames: &Frames) -> serde_json::Map<String, serde_json::Value> {
    let mut settings = serde_json::Map::new();
    if let Some(exposure_us) = frames.exposure_us {
        settings.insert("exposure_us".into(), json!(exposure_us));
    }
    match (&frames.pulses_of, frames.exposure_us) {
        // Each begins with its pulse.
        (Some(_), Some(_)) => {
            settings.insert("triggered".into(), json!(true));
            if frames.edge == Some(Begin::Falling) {
                settings.insert("genicam".into(), json!({ "TriggerActivation": "FallingEdge" }));
            }
        }
        // Each is as long as its pulse.
        (Some(events), None) => {
            settings.insert("strobe_line".into(), json!("imported"));
            settings.insert("strobe_to".into(), json!([events]));
        }
        (None, _) => {}
    }
    settings
}
