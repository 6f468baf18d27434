//! What a simulated event camera looks at: a video, a folder of pictures, or an archive of grey levels.

use std::path::{Path, PathBuf};

use erfgs_dataset::import;
use erfgs_events::npz::{self, LumaSequence};
use erfgs_replay::Luma;
use erfgs_scene::{
    image::ImageRgb8,
    video::{FrameTimes, Video},
};

use crate::errors::Usage;

/// Grey levels of a frame.
pub enum Grey<'a> {
    Bytes(&'a [u8]),
    Floats(Vec<f32>),
}

impl Grey<'_> {
    pub fn luma(&self) -> Luma<'_> {
        match self {
            Self::Bytes(levels) => Luma::U8(levels),
            Self::Floats(levels) => Luma::F32(levels),
        }
    }
}

/// Frames one after the other.
pub struct Frames {
    from: Source,
    /// When they are shown.
    times: FrameTimes,
    /// The frame that was read to learn how large they are.
    first: Option<ImageRgb8>,
    size: [u32; 2],
    next: usize,
}

enum Source {
    Archive(LumaSequence),
    Pictures(Vec<PathBuf>),
    Video { path: PathBuf, video: Video, count: Option<u64> },
}

impl Frames {
    /// Opens the input. `fps` are the frames in a second; without it a video has the times that it is shown at.
    pub fn open(path: &Path, fps: Option<f64>) -> anyhow::Result<Self> {
        let rate = || {
            let why = format!("--fps is needed: nothing in '{}' says how many frames a second it has", path.display());
            fps.map(FrameTimes::Even).ok_or(Usage(why))
        };
        if path.is_dir() {
            let pictures = import::pictures(path)?;
            if pictures.is_empty() {
                return Err(Usage(format!("there is no PNG or JPEG file in '{}'", path.display())).into());
            }
            return Self::after_first(Source::Pictures(pictures), rate);
        }
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npz")) {
            let archive = npz::read_luma(path)?;
            let size = [archive.width, archive.height];
            return Ok(Self { from: Source::Archive(archive), times: rate()?, first: None, size, next: 0 });
        }
        let times = || match fps {
            Some(_) => rate(),
            None => FrameTimes::of(path).map_or_else(rate, Ok),
        };
        let video = Video::open(path)?;
        let count = Video::probe(path).map(|probe| probe.frames);
        Self::after_first(Source::Video { path: path.to_owned(), video, count }, times)
    }

    fn after_first(mut from: Source, times: impl FnOnce() -> Result<FrameTimes, Usage>) -> anyhow::Result<Self> {
        let first = from.picture(0)?;
        let Some(first) = first else {
            return Err(Usage(format!("'{}' has no frame", from.name(0).display())).into());
        };
        let size = [first.width, first.height];
        if size.iter().any(|side| u16::try_from(*side).is_err()) {
            let [width, height] = size;
            let name = from.name(0);
            return Err(
                Usage(format!("{} has {width} x {height} pixels, more than events can tell", name.display())).into()
            );
        }
        Ok(Self { from, times: times()?, first: Some(first), size, next: 0 })
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// How many there are, where that is known.
    pub fn count(&self) -> Option<u64> {
        match &self.from {
            Source::Archive(archive) => Some(archive.frames as u64),
            Source::Pictures(pictures) => Some(pictures.len() as u64),
            Source::Video { count, .. } => *count,
        }
    }

    /// The next frame and when it is shown, nanoseconds; none after the last.
    pub fn next(&mut self) -> anyhow::Result<Option<(Grey<'_>, i64)>> {
        let index = self.next;
        self.next += 1;
        if matches!(self.from, Source::Archive(_)) {
            return self.levels(index);
        }
        let picture = match self.first.take() {
            Some(first) => Some(first),
            None => self.from.picture(index)?,
        };
        let Some(picture) = picture else { return Ok(None) };
        if [picture.width, picture.height] != self.size {
            let ([width, height], name) = (self.size, self.from.name(index).display());
            return Err(Usage(format!(
                "frame {index} of {name} has {} x {} pixels, and the first has {width} x {height}",
                picture.width, picture.height
            ))
            .into());
        }
        Ok(Some((Grey::Floats(picture.luma()), self.shown(index)?)))
    }

    /// A frame of an archive.
    fn levels(&self, index: usize) -> anyhow::Result<Option<(Grey<'_>, i64)>> {
        let Source::Archive(archive) = &self.from else { return Ok(None) };
        match archive.iter().nth(index) {
            Some(levels) => Ok(Some((Grey::Bytes(levels), self.shown(index)?))),
            None => Ok(None),
        }
    }

    /// When a frame is shown, nanoseconds.
    fn shown(&self, index: usize) -> Result<i64, Usage> {
        self.times.since(0, index as u64).ok_or_else(|| {
            let name = self.from.name(index).display();
            Usage(format!("{name} has more frames than its container has times; give --fps"))
        })
    }
}

impl Source {
    /// The frame that follows; none after the last.
    fn picture(&mut self, index: usize) -> anyhow::Result<Option<ImageRgb8>> {
        match self {
            Self::Archive(_) => Ok(None),
            Self::Pictures(pictures) => Ok(pictures.get(index).map(|path| ImageRgb8::read(path)).transpose()?),
            Self::Video { video, .. } => Ok(video.next_frame()?),
        }
    }

    /// The file that a frame is in.
    fn name(&self, index: usize) -> &Path {
        match self {
            Self::Archive(_) => Path::new(""),
            Self::Pictures(pictures) => pictures.get(index).map_or(Path::new(""), PathBuf::as_path),
            Self::Video { path, .. } => path,
        }
    }
}
