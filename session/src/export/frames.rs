//! The frames of a stream as pictures and videos.

use std::{
    collections::HashMap,
    fmt::Write,
    path::{Path, PathBuf},
};

use erfgs_base::atomic::{self, Together, numbered};
#[cfg(feature = "exr")]
use erfgs_scene::exr;
use erfgs_scene::{pixel, video::VideoWriter};

use super::{ExportError, depth, is_passed_over, sensor_frames};
use crate::{
    clock::{EpochCursor, Epochs, Exposure},
    container::{Entry, Recording, SessionStart},
    source::{Description, Encoding, Packet},
};

/// Mean frames a second of a stream that does not say.
pub(super) const UNKNOWN_RATE_HZ: f64 = 30.0;

/// What frames are written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FramesFormat {
    /// One file for each frame; of 16 bits where the camera gave more than 8.
    Png,
    /// The same in linear light; of Bayer and deep grey frames all that the sensor gave.
    #[cfg(feature = "exr")]
    Exr,
    /// A video of H.264, by ffmpeg, at the mean rate of the frames.
    Mp4,
}

/// How frames are written.
#[derive(Clone, Copy, Debug)]
pub struct FramesChoice<'a> {
    /// As what.
    pub format: FramesFormat,
    /// When they were exposed, where that is known.
    pub exposures: Option<&'a Exposures<'a>>,
    /// How many bits of samples of 16 count (AEDAT 4), where the user says it.
    pub bits: Option<u8>,
}

impl FramesFormat {
    /// Whether a stream becomes a folder.
    #[must_use]
    pub fn is_folder(self) -> bool {
        self.pictures().is_some()
    }

    /// The extension of the pictures that a stream becomes.
    fn pictures(self) -> Option<&'static str> {
        match self {
            Self::Png => Some("png"),
            #[cfg(feature = "exr")]
            Self::Exr => Some("exr"),
            Self::Mp4 => None,
        }
    }
}

/// Digits of the number that is the name of a picture.
pub const PICTURE_DIGITS: usize = 6;

/// When the frames of a stream were exposed, as far as clocks that were fitted tell.
#[derive(Clone, Debug)]
pub struct Exposures<'a> {
    /// The exposure of each frame of a camera, by the number of its packet.
    pub frames: HashMap<u64, Exposure>,
    /// The clocks of the device, which date the frames of an event sensor.
    pub epochs: &'a Epochs,
}

/// How many frames were written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrittenFrames {
    /// Frames in the files.
    pub frames: u64,
    /// Frames that do not decode: cut or damaged.
    pub damaged: u64,
    /// Mean frames a second.
    pub rate_hz: f64,
}

/// Writes the frames of the stream `id` to `path`, a folder or a file as the format has it, and beside them a table of their
/// times. All of it appears when it is whole, and pictures of an earlier export go then. A stream without a frame leaves nothing behind. What was lost to damage of the recording is added to `damage`;
/// `progress` is called with the frames so far, of event sensors with the bytes of payload.
///
/// # Errors
/// If the recording has no such stream or cannot be read, if it leaves open how many bits of its samples count, or if a file cannot be written.
pub fn write_frames(
    recording: &mut Recording,
    id: &str,
    choice: FramesChoice<'_>,
    path: &Path,
    damage: &mut Vec<String>,
    mut progress: impl FnMut(u64),
) -> Result<WrittenFrames, ExportError> {
    let (stream, _) = recording.stream(id)?;
    let FramesChoice { format, exposures, bits } = choice;
    let mut writing = Writing::begin(recording, stream, format, path, exposures);
    if writing.is_of_sensor {
        let bits = depth::of(recording, stream, bits)?;
        sensor_frames::decode(recording, stream, (&mut writing, bits), damage, progress)?;
    } else {
        let mut packets = 0;
        for entry in recording.messages(None) {
            match entry {
                Ok(Entry::Packet { stream: of, packet }) if of == stream => {
                    packets += 1;
                    writing.push_packet(&packet)?;
                    progress(writing.written.frames);
                }
                Ok(_) => {}
                Err(error) if is_passed_over(&error) => damage.push(error.to_string()),
                Err(error) => return Err(error.into()),
            }
        }
        damage.extend(recording.lacking(stream, packets));
    }
    writing.finish()
}

/// The name of the file with the times of the frames of a folder.
const LIST: &str = "frames.csv";

/// The file with the times of the frames.
fn list_beside(out: &Path, is_folder: bool, is_of_sensor: bool) -> PathBuf {
    match (is_folder, is_of_sensor) {
        (true, _) => out.join(LIST),
        // The name with `.csv` alone is that of the events.
        (false, true) => out.with_extension("frames.csv"),
        (false, false) => out.with_extension("csv"),
    }
}

/// Where frames go.
enum Out {
    Png,
    #[cfg(feature = "exr")]
    Exr,
    Mp4(Option<VideoWriter>),
}

/// A stream that is being written.
pub(super) struct Writing<'a> {
    path: &'a Path,
    /// The extension of pictures, which lie in a folder.
    pictures: Option<&'static str>,
    /// The folder while it is being filled, from the first frame on.
    folder: Option<Together>,
    is_of_sensor: bool,
    out: Out,
    description: Description,
    start: SessionStart,
    exposures: Option<&'a Exposures<'a>>,
    times: String,
    written: WrittenFrames,
}

impl<'a> Writing<'a> {
    fn begin(
        recording: &Recording,
        stream: usize,
        format: FramesFormat,
        path: &'a Path,
        exposures: Option<&'a Exposures<'a>>,
    ) -> Self {
        let summary = recording.summary();
        let recorded = &summary.streams[stream];
        let rate_hz = recorded.totals.rate_hz().unwrap_or(UNKNOWN_RATE_HZ);
        let is_of_sensor = recorded.description.encoding.has_sensor_frames();
        Self {
            path,
            pictures: format.pictures(),
            folder: None,
            is_of_sensor,
            out: match format {
                FramesFormat::Png => Out::Png,
                #[cfg(feature = "exr")]
                FramesFormat::Exr => Out::Exr,
                FramesFormat::Mp4 => Out::Mp4(None),
            },
            description: recorded.description.clone(),
            start: summary.start.clone(),
            exposures,
            times: match is_of_sensor {
                true => "frame,exposure_start_us,exposure_end_us,exposure_mid_ns\n".to_owned(),
                false => "frame,sequence,arrival_ns,exposure_mid_ns\n".to_owned(),
            },
            written: WrittenFrames { frames: 0, damaged: 0, rate_hz },
        }
    }

    /// Takes this for the rate of the frames.
    pub fn set_rate(&mut self, rate_hz: f64) {
        self.written.rate_hz = rate_hz;
    }

    /// Writes a frame of a camera.
    fn push_packet(&mut self, packet: &Packet) -> Result<(), ExportError> {
        let mid = self.exposures.and_then(|exposures| exposures.frames.get(&packet.sequence));
        let mid = mid.map_or(String::new(), |exposure| exposure.mid_ns.to_string());
        let times = format!("{},{},{mid}", packet.sequence, self.start.session_ns(packet.host_ns));
        self.push(&times, &packet.payload)
    }

    /// The clocks of the stream, if they are known.
    pub fn clocks(&self) -> Option<EpochCursor<'a>> {
        self.exposures.map(|exposures| exposures.epochs.follow())
    }

    /// Writes a frame of an event sensor, which is exposed at these device times; the middle in session time, if it is known.
    pub fn push_exposed(
        &mut self,
        encoding: Encoding,
        [width, height]: [u16; 2],
        exposure_us: [u64; 2],
        mid_ns: Option<i64>,
        payload: &[u8],
    ) -> Result<(), ExportError> {
        let description = &mut self.description;
        (description.encoding, description.width, description.height) = (encoding, width.into(), height.into());
        description.settings.clear();
        let [start_us, end_us] = exposure_us;
        let mid = mid_ns.map_or(String::new(), |mid| mid.to_string());
        self.push(&format!("{start_us},{end_us},{mid}"), payload)
    }

    fn push(&mut self, times: &str, payload: &[u8]) -> Result<(), ExportError> {
        let index = self.written.frames;
        if self.pictures.is_some() && self.folder.is_none() {
            let begun = Together::begin(self.path);
            self.folder = Some(begun.map_err(ExportError::writing(self.path))?);
        }
        let path = self.folder.as_ref().map_or(self.path, Together::path);
        if !self.out.push(path, index, &self.description, payload, self.written.rate_hz)? {
            self.written.damaged += 1;
            return Ok(());
        }
        let _ = writeln!(self.times, "{index},{times}");
        self.written.frames += 1;
        Ok(())
    }

    fn finish(self) -> Result<WrittenFrames, ExportError> {
        if let Out::Mp4(Some(video)) = self.out {
            video.finish()?;
        }
        if self.written.frames > 0 {
            let is_folder = self.folder.is_some();
            let list =
                list_beside(self.folder.as_ref().map_or(self.path, Together::path), is_folder, self.is_of_sensor);
            atomic::write(&list, self.times.as_bytes()).map_err(ExportError::writing(&list))?;
            if let (Some(folder), Some(extension)) = (self.folder, self.pictures) {
                let is_picture = numbered(PICTURE_DIGITS, extension);
                let placed = folder.finish(|name| name == LIST || is_picture(name));
                placed.map_err(ExportError::writing(self.path))?;
            }
        }
        Ok(self.written)
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
    ) -> Result<bool, ExportError> {
        let file = |extension: &str| path.join(format!("{index:0PICTURE_DIGITS$}.{extension}"));
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
            #[cfg(feature = "exr")]
            Self::Exr if is_deep || matches!(format.pixels, pixel::PixelFormat::Bayer(..)) => {
                let Ok(light) = format.light(payload) else { return Ok(false) };
                exr::write_light(&file("exr"), &light)?;
            }
            #[cfg(feature = "exr")]
            Self::Exr => {
                let Ok(image) = format.picture(payload) else { return Ok(false) };
                exr::write_rgb8(&file("exr"), &image)?;
            }
            Self::Mp4(video) => {
                let Ok(image) = format.picture(payload) else { return Ok(false) };
                if video.is_none() {
                    *video = Some(VideoWriter::create(path, image.width, image.height, rate_hz)?);
                }
                if let Some(video) = video {
                    video.push(&image.data)?;
                }
            }
        }
        Ok(true)
    }
}
