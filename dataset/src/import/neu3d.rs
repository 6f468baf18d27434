//! Neural 3D Video (Neu3D, DyNeRF).
//!
//! ```text
//! poses_bounds.npy                       one row for each camera, in the order of their names
//! cam00.mp4, cam01.mp4, ...              numbers may have gaps, where cameras were taken out
//! cam00/*.png or cam00/images/*.png      instead of a video: frames in the order of their numbers
//! ```
//! Frames are at the times that the videos say, also where they are decoded already, or at those of the option `fps`; folders of
//! images without their videos are taken for 30 frames a second. `cam00`, the centre camera, is held out. Each camera has its own row of intrinsics. Images may be smaller than the
//! poses say (4DGS reduces them to 1352 x 1014); the intrinsics follow.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{
    ImportError, ImportOptions, Imported,
    common::{self, FileFrame, Frames, SourceView, poses_bounds},
    stamps,
    write::{self, SourceRecording},
};
use crate::Split;
use erfgs_base::progress::Progress;
use erfgs_scene::{
    exchange::llff::BOUNDS_LEFT_OUT,
    video::{FrameTimes, Video},
};

/// The rate of the published recordings, for folders of images whose video is not there.
const FPS: f64 = 30.0;

/// Imports the recording in `source` into a new dataset in the folder `out`.
///
/// # Errors
/// If the source is incomplete or malformed, or the dataset cannot be written.
pub fn import(
    source: &Path,
    options: &ImportOptions,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Imported, ImportError> {
    let given = options.fps.map(|_| common::fps(options, FPS)).transpose()?;
    let range = common::checked_range(options)?;
    let poses = source.join("poses_bounds.npy");
    let rows = poses_bounds(&poses)?;
    let cameras = cameras(source)?;
    if rows.len() != cameras.len() {
        let names: Vec<&str> = cameras.keys().map(String::as_str).collect();
        let what = format!(
            "it holds {} poses, but there are {} cameras ({}); each row belongs to one camera, in order of the names",
            rows.len(),
            cameras.len(),
            names.join(", ")
        );
        return Err(ImportError::Malformed { path: poses, what });
    }
    common::check_rows(cameras.keys().map(String::as_str), &poses)?;
    let mut views: Vec<SourceView> = Vec::new();
    let mut expected = None;
    let mut clock = Clock { given, common: None };
    for ((name, Source { path, video }), row) in cameras.into_iter().zip(rows) {
        let (intrinsics, pose) =
            row.map_err(|what| ImportError::Camera { camera: name.clone(), path: poses.clone(), what })?;
        let frames = if path.is_dir() {
            let all = common::frames(&path)?;
            let first = expected.get_or_insert_with(|| (name.clone(), all.len()));
            if first.1 != all.len() {
                let what = format!("the folder holds {} images, but that of camera {} {}", all.len(), first.0, first.1);
                return Err(ImportError::Camera { camera: name, path, what });
            }
            let times = clock.times(&name, video.as_deref(), Some(all.len() as u64))?;
            let frames = common::in_range(all, options, &path)?;
            let from = range.map_or(0, |(first, _)| first);
            let time = |at: usize| times.since(from, from + at as u64).unwrap_or(0);
            let frame = |(at, image)| FileFrame { image, mask: None, t_ns: time(at) };
            Frames::Files(frames.into_iter().enumerate().map(frame).collect())
        } else {
            let (first, last) = range.map_or((0, None), |(first, last)| (first, Some(last)));
            let times = clock.times(&name, Some(&path), None)?;
            Frames::Video { path, first, last, times }
        };
        let split = if common::number(&name) == Some(0) { Split::Test } else { Split::Train };
        views.push(SourceView { name, split, intrinsics, pose, frames });
    }
    common::override_split(&mut views, options)?;
    let (fps, description) = match &clock.common {
        Some((_, times, true)) => (times.rate(), clock.description()),
        _ if views.iter().all(|view| view.files().is_some()) => stamps::place(&mut views, given, FPS)?,
        common => (common.as_ref().map_or(FPS, |(_, times, _)| times.rate()), clock.description()),
    };
    let mut notes = common::order_notes(views.iter().filter_map(SourceView::files), &description);
    if views.iter().any(|view| matches!(view.frames, Frames::Video { .. })) {
        notes.push(format!("videos: {description}"));
    }
    notes.push(BOUNDS_LEFT_OUT.to_owned());
    let recording = SourceRecording { importer: "neu3d", source, views, any_size: true, fps, points: None, notes };
    write::write(recording, options, out, progress)
}

/// When the frames are taken, of all cameras alike.
struct Clock {
    /// The rate that the user gives.
    given: Option<f64>,
    /// The first camera, its times, and whether its video says them.
    common: Option<(String, FrameTimes, bool)>,
}

impl Clock {
    /// The times of a camera's frames, as its video says them; `images` if so many frames are decoded already.
    fn times(&mut self, name: &str, video: Option<&Path>, images: Option<u64>) -> Result<FrameTimes, ImportError> {
        if let Some(fps) = self.given {
            let times = FrameTimes::Even(fps);
            self.common.get_or_insert_with(|| (name.to_owned(), times.clone(), false));
            return Ok(times);
        }
        let wrong =
            |path: &Path, what: String| ImportError::Camera { camera: name.to_owned(), path: path.to_owned(), what };
        let video_times = match video {
            Some(path) => match (FrameTimes::of(path), images) {
                (Some(times), _) => Some((path, times)),
                // Decoded frames can do without their video.
                (None, Some(_)) => None,
                (None, None) => {
                    let broken = |source| ImportError::Video { camera: name.to_owned(), source };
                    Video::open(path).map_err(broken)?.next_frame().map_err(broken)?;
                    return Err(wrong(
                        path,
                        "it does not say when its frames are shown; give their rate with --fps".into(),
                    ));
                }
            },
            None => None,
        };
        if let (Some((path, FrameTimes::Uneven(times))), Some(images)) = (&video_times, images)
            && times.len() as u64 != images
        {
            let what = format!(
                "it has {} frames at uneven times, and the folder of its frames {images}; take the folder away, or give --fps",
                times.len()
            );
            return Err(wrong(path, what));
        }
        let is_known = video_times.is_some();
        let times = video_times.as_ref().map_or(FrameTimes::Even(FPS), |(_, times)| times.clone());
        let (first, common, _) = self.common.get_or_insert_with(|| (name.to_owned(), times.clone(), is_known));
        let frames = [&times, &*common].into_iter().filter_map(|times| match times {
            FrameTimes::Uneven(times) => Some(times.len() as u64),
            FrameTimes::Even(_) => None,
        });
        if !times.agree(common, frames.min().or(images).unwrap_or(COMPARED)) {
            let what = format!(
                "its frames have {:.6} a second (or other gaps), those of camera {first} {:.6}: they have no times in common; give one \
                 rate for all with --fps, or make the videos alike",
                times.rate(),
                common.rate()
            );
            return Err(wrong(video.unwrap_or(Path::new("")), what));
        }
        Ok(times)
    }

    /// The rate and where it comes from, for the user.
    fn description(&self) -> String {
        match (&self.common, self.given) {
            (_, Some(fps)) => format!("{fps} frames a second, as --fps says"),
            (Some((_, FrameTimes::Uneven(_), _)), _) => "frames at the uneven times that the videos say".to_owned(),
            (Some((_, FrameTimes::Even(rate), true)), _) => format!("{rate} frames a second, as the videos say"),
            _ => format!("{FPS} frames a second are assumed, --fps says another rate"),
        }
    }
}

/// Frames at two rates that are compared: these are 10 s of 30 a second, after which rates that differ by a 1000th are apart.
const COMPARED: u64 = 300;

/// A camera: a video, or a folder of images, perhaps with the video that they were decoded from.
struct Source {
    path: PathBuf,
    video: Option<PathBuf>,
}

/// The cameras by name: folders of images, or else videos.
fn cameras(source: &Path) -> Result<BTreeMap<String, Source>, ImportError> {
    let mut cameras: BTreeMap<String, Source> = BTreeMap::new();
    let (mut folders, mut videos) = (Vec::new(), Vec::new());
    for (name, path) in common::entries(source)? {
        let stem = common::stem(&path);
        let is_camera = |name: &str| {
            name.strip_prefix("cam")
                .is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()))
        };
        if path.is_dir() && is_camera(&name) {
            let inner = path.join("images");
            let folder = if inner.is_dir() { inner } else { path };
            if !common::images(&folder)?.is_empty() {
                folders.push((name, folder));
            }
        } else if is_camera(&stem) && path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mp4")) {
            videos.push((stem, path));
        }
    }
    // A folder holds what was decoded from the video of the same name before.
    cameras.extend(videos.into_iter().map(|(name, path)| (name, Source { path, video: None })));
    for (name, path) in folders {
        let video = cameras.remove(&name).map(|camera| camera.path);
        cameras.insert(name, Source { path, video });
    }
    if cameras.is_empty() {
        let remedy = "a Neu3D folder holds cam00.mp4, cam01.mp4, ... or folders of images of these names";
        return Err(ImportError::Missing { path: source.join("cam00.mp4"), remedy });
    }
    Ok(cameras)
}
